#include "server/service/scene_model.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "proto/scene/scene.hpp"
#include "proto/scene/with_message.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"
#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/adiabatic_shear.hpp"
#include "server/physics/material/caution.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/parts.hpp"
#include "server/service/own_laws.hpp"

namespace shearbus::service {
namespace {

// Thrown by convert(): the faults with the keys of the scene that they are about. scene_model() finds the line of each
// key.
struct Refused {
  std::vector<scene::Fault> faults;
  std::string remedy;
};

[[noreturn]] void refuse(std::string key, std::string text, std::string remedy) {
  throw Refused{{{std::move(key), std::move(text), {}}}, std::move(remedy)};
}

physics::Material material_of(const v1::Body& body, const std::string& table) {
  physics::MaterialResult made = physics::make_material(body.material(), scene::numbers_of(body),
                                                        physics::FlowLaws::numbered(static_cast<int>(body.flow_law())));
  if (!made.fault.empty())
    refuse(table + "." + made.fault_field,
           fmt::format("{}.{}: {}", table, made.fault_field, wire::printable(made.fault, wire::kMaxTextBytes)),
           "Name a material of the catalog, or give every constant.");
  if (body.melting_curve() == v1::MELTING_CURVE_LINDEMANN)
    choose_melting_curve(made.material, physics::MeltingCurve::kLindemann);
  if (body.melting_curve() == v1::MELTING_CURVE_SIMON) {
    if (body.has_melting_temperature_k() && body.melting_temperature_k() != made.material.simon_temperature)
      refuse(table + ".melting_temperature_k",
             fmt::format("{0}.melting_temperature_k = {1} is not {0}.simon_temperature_k, at which the curve of "
                         "melting_curve = \"simon\" starts",
                         table, body.melting_temperature_k()),
             "Leave melting_temperature_k out, or choose another melting_curve.");
    choose_melting_curve(made.material, physics::MeltingCurve::kSimon);
  }
  if (body.pressure_term() == v1::PRESSURE_TERM_COMPRESSED)
    made.material.pressure_term = physics::PressureTerm::kCompressed;
  return made.material;
}

// A table of k(T) or c(T) in parts of the body's constant `of`; empty where the scene has none.
template <typename List>
physics::HeatTable heat_table_of(const List& temperatures, const List& values, double of, std::string key) {
  constexpr double kMost = 20.0;
  constexpr std::string_view kTable = "_table";
  physics::HeatTable table{{temperatures.begin(), temperatures.end()}, {}};
  for (const double value : values) {
    const double share = value / of;
    if (!(share >= physics::Material::kLeastHeatShare && share <= kMost))
      refuse(key,
             fmt::format("{} has the value {}, expected a twentieth to {} times {} = {}", key, value, kMost,
                         std::string(key).erase(key.find(kTable), kTable.size()), of),
             "Give both in one unit, and the constant in the middle of the table.");
    table.share.push_back(share);
  }
  return table;
}

std::shared_ptr<const physics::HeatTables> heat_tables_of(const v1::Scene& scene,
                                                          const physics::ModelOptions& options) {
  physics::HeatTables tables;
  auto keys = std::begin(physics::kHeatTables);
  const auto add = [&](const auto& temperatures, const auto& values, double of) {
    tables.*keys->table = heat_table_of(temperatures, values, of, keys->values);
    ++keys;
  };
  const auto add_tables_of = [&](const v1::Body& body, const physics::Material& made) {
    add(body.thermal_conductivity_table_temperature_k(), body.thermal_conductivity_table_w_per_m_k(),
        made.conductivity);
    add(body.specific_heat_table_temperature_k(), body.specific_heat_table_j_per_kg_k(), made.specific_heat);
  };
  add_tables_of(scene.soft(), options.soft);
  add_tables_of(scene.hard(), options.hard);
  if (std::ranges::all_of(physics::kHeatTables, [&](const auto& row) { return (tables.*row.table).empty(); }))
    return nullptr;
  return std::make_shared<const physics::HeatTables>(std::move(tables));
}

physics::FarBoundary far_boundary_of(v1::FarBoundary boundary) {
  return boundary == v1::FAR_BOUNDARY_HALF_SPACE   ? physics::FarBoundary::kHalfSpace
         : boundary == v1::FAR_BOUNDARY_ISOTHERMAL ? physics::FarBoundary::kIsothermal
                                                   : physics::FarBoundary::kInsulated;
}

// Fills in the absent keys of [hard_layer] from [layer]. `cells` and `grading` stay absent in a scene with a tolerance,
// for which the server chooses the cells. An absent thickness is that of [layer] times the ratio of the depths that
// heat reaches in the hard and in the soft body, the square root of the ratio of their diffusivities.
void fill_hard_layer(v1::Scene& scene, const physics::ModelOptions& options) {
  const v1::Layer& layer = scene.layer();
  v1::HardLayer& hard = *scene.mutable_hard_layer();
  if (!hard.has_thickness_m())
    hard.set_thickness_m(layer.thickness_m() * std::sqrt(options.hard.diffusivity / options.soft.diffusivity));
  if (!hard.has_cells() && layer.has_cells()) hard.set_cells(layer.cells());
  if (!hard.has_grading() && layer.has_grading()) hard.set_grading(layer.grading());
  if (hard.far_boundary() == v1::FAR_BOUNDARY_UNSPECIFIED) hard.set_far_boundary(layer.far_boundary());
}

// Fills in the absent constants of [junctions] from the soft metal. The yield strength of unstrained junctions is the
// yield strength of the interface.
void fill_junctions(v1::Junctions& junctions, const physics::Material& soft) {
  const bool soft_hardens_as_junctions =
      physics::has_constant(soft.flow_law, &physics::Material::hardening_coefficient);
  if (!soft_hardens_as_junctions && !(junctions.has_hardening_coefficient() && junctions.has_hardening_exponent()))
    refuse("junctions.hardening_coefficient",
           fmt::format("[junctions] needs hardening_coefficient and hardening_exponent of its own: the soft body's "
                       "flow law {} has none",
                       physics::FlowLaws::name_of(soft.flow_law)),
           "Give both.");
  if (!junctions.has_yield_strength_max_pa() && std::isfinite(soft.yield_strength_max))
    junctions.set_yield_strength_max_pa(soft.yield_strength_max);
  if (!junctions.has_hardening_coefficient()) junctions.set_hardening_coefficient(soft.hardening_coefficient);
  if (!junctions.has_hardening_exponent()) junctions.set_hardening_exponent(soft.hardening_exponent);
}

physics::JunctionOptions junctions_of(const v1::Junctions& junctions, const physics::ModelOptions& options) {
  physics::Material metal = options.soft;
  // hardening law of junctions, DLP (52-53)
  metal.flow_law = physics::FlowLaws::place<physics::SteinbergCochranGuinan>();
  metal.yield_strength = options.interface.yield_strength;
  metal.yield_strength_max = junctions.has_yield_strength_max_pa() ? junctions.yield_strength_max_pa()
                                                                   : std::numeric_limits<double>::infinity();
  metal.hardening_coefficient = junctions.hardening_coefficient();
  metal.hardening_exponent = junctions.hardening_exponent();
  return {.contact_fraction = junctions.contact_fraction(), .height = junctions.height_m(), .metal = metal};
}

// A scene with a tolerance gives no cells, nor one with heat modes, which need none: the options have the default.
template <typename Table>
physics::GridOptions grid_of(const Table& table) {
  return {.thickness = table.thickness_m(),
          .cells = table.has_cells() ? static_cast<int>(table.cells()) : physics::GridOptions{}.cells,
          .grading = table.has_grading() ? table.grading() : 1.0,
          .far_boundary = far_boundary_of(table.far_boundary())};
}

// The law "own:NAME" of a scene; null for the laws of the list.
const shearbus_friction_law* own_law_of(const v1::Interface& law) {
  if (law.friction_law() != v1::FRICTION_LAW_OWN) return nullptr;
  const auto& laws = own_laws();
  if (const auto found = laws.find(law.own_friction_law()); found != laws.end()) return found->second;
  std::string names;
  for (const auto& [name, known] : laws) names += fmt::format("{}\"own:{}\"", names.empty() ? "only " : ", ", name);
  refuse(
      "interface.friction_law",
      fmt::format("interface.friction_law = \"own:{}\": this server has loaded {}",
                  wire::printable(law.own_friction_law(), wire::kMaxTextBytes),
                  names.empty() ? "no law of its own" : names),
      "Give --friction-law NAME=/path/library.so to shearbus-server (its administrator does) or to shearbus-replay, or "
      "choose another law.");
}

physics::InterfaceOptions interface_of(const v1::Interface& law) {
  return {.friction_coefficient = law.friction_coefficient(),
          .yield_strength = law.yield_strength_pa(),
          .friction_law =
              physics::FrictionLaws::numbered(static_cast<int>(law.friction_law())).value_or(physics::FrictionLaw{}),
          .friction_coefficient_fast = law.friction_coefficient_fast(),
          .velocity_decay = law.velocity_decay_s_per_m(),
          .friction_reference_temperature = law.friction_reference_temperature_k(),
          .friction_softening_exponent = law.friction_softening_exponent(),
          .slip_length = law.slip_length_m(),
          .reference_velocity = law.reference_velocity_m_per_s(),
          .direct_effect = law.direct_effect(),
          .evolution_effect = law.evolution_effect(),
          .state_evolution = law.state_evolution() == v1::STATE_EVOLUTION_SLIP ? physics::StateEvolution::kSlip
                                                                               : physics::StateEvolution::kAgeing,
          .own = own_law_of(law)};
}

void set_layer(const v1::Layer& layer, physics::ModelOptions& options) {
  options.grid = grid_of(layer);
  options.initial_temperature = layer.initial_temperature_k();
  options.inertia = layer.inertia();
  options.sleep = layer.sleep();
  if (layer.time_integrator() == v1::TIME_INTEGRATOR_SDIRK2) options.time_integrator = physics::TimeIntegrator::kSdirk2;
  if (layer.heat() == v1::HEAT_MODES)
    options.modes = physics::ModesOptions{.accuracy = layer.modes().accuracy(),
                                          .shortest_step = layer.modes().shortest_step_s(),
                                          .longest_time = layer.modes().longest_time_s()};
}

// Refuses options that exclude each other according to the table of parts in server/physics/solver/parts_table.hpp.
void refuse_what_excludes_each_other(const physics::ModelOptions& options) {
  std::vector<physics::Refusal> refusals = physics::refusals(options);
  Refused refused;
  for (physics::Refusal& refusal : refusals) {
    if (refusals.size() == 1)
      refused.remedy = std::move(refusal.remedy);
    else
      refusal.text += fmt::format(" ({})", refusal.remedy);
    refused.faults.push_back({std::move(refusal.key), std::move(refusal.text), {}});
  }
  if (!refused.faults.empty()) throw Refused(std::move(refused));
}

// The share of the plastic work that becomes heat, from the table of the strategy.
std::optional<double> taylor_quinney_factor_of(const v1::Scene& scene) {
  const bool forced = scene.strategy() == v1::STRATEGY_FORCE_DRIVEN;
  const bool of_other =
      forced ? scene.velocity_driven().has_taylor_quinney_factor() : scene.interface().has_taylor_quinney_factor();
  if (of_other) {
    const char* const key = forced ? "velocity_driven.taylor_quinney_factor" : "interface.taylor_quinney_factor";
    const char* const own = forced ? "interface.taylor_quinney_factor" : "velocity_driven.taylor_quinney_factor";
    refuse(key, fmt::format("{} belongs to the other strategy, here the key is {}", key, own), "Move it there.");
  }
  if (forced && scene.interface().has_taylor_quinney_factor()) return scene.interface().taylor_quinney_factor();
  if (scene.velocity_driven().has_taylor_quinney_factor()) return scene.velocity_driven().taylor_quinney_factor();
  return {};
}

// Friction of a velocity-driven interface: that of [interface], or in short the one coefficient of [velocity_driven].
std::optional<double> friction_coefficient_of(const v1::Scene& scene) {
  const v1::VelocityDriven& driven = scene.velocity_driven();
  if (scene.strategy() == v1::STRATEGY_FORCE_DRIVEN || !scene.has_interface())
    return driven.has_friction_coefficient() ? std::optional(driven.friction_coefficient()) : std::nullopt;
  if (driven.has_friction_coefficient())
    refuse("velocity_driven.friction_coefficient",
           "velocity_driven.friction_coefficient is in short for the table [interface], and the scene gives both",
           "Leave out one of the two.");
  return scene.interface().friction_coefficient();
}

// The warning of an interface that slips on coarse zones of a host's mesh only; empty: none. A strength of more than
// metal has without a defect, about a thirtieth of the shear modulus (Mackenzie 1949), is meant as no limit: a note.
std::string strength_warning(const v1::Scene& scene, const physics::ModelOptions& options) {
  if (options.strategy != physics::Strategy::kForceDriven || options.plastic_layer) return {};
  const double share = options.junctions ? options.junctions->contact_fraction : 1.0;
  const double strength = share * options.interface.yield_strength;
  if (strength <= physics::fresh_strength(options.soft)) return {};  // Y* is not below this
  const double most = physics::adiabatic_peak(options.soft, 0.0, options.initial_temperature).stress;
  if (strength <= most) return {};
  const bool unlimited = strength > physics::kSqrt3 * options.soft.shear_modulus / 30.0;
  return fmt::format(
      "{}interface.yield_strength_pa{} = {:.4g} Pa is above Y* = {:.4g} Pa, the largest flow stress of the soft metal "
      "as its work heats it: on fine zones of a host whose metal yields, the metal shears in place of slip, and the "
      "slip depends on the zones; set interface.plastic_layer = true",
      unlimited ? wire::kNote : std::string_view(), scene.has_junctions() ? " * junctions.contact_fraction" : "",
      strength, most);
}

// The warnings of constants of which each has a value that may be, and that contradict each other.
void add_contradictions(const v1::Scene& scene, const physics::ModelOptions& options,
                        std::vector<std::string>& warnings) {
  const auto ends_below = [&](double first, const std::string& first_key, double last, const std::string& last_key) {
    if (first > last)
      warnings.push_back(
          fmt::format("{} = {} Pa is above {} = {} Pa, where hardening ends, and is not reached. Are they "
                      "in one unit, and of one metal?",
                      first_key, scene::number_text(first), last_key, scene::number_text(last)));
  };
  const auto check_body = [&](const physics::Material& body, const std::string& name) {
    if (physics::has_constant(body.flow_law, &physics::Material::yield_strength_max))
      ends_below(body.yield_strength, name + ".yield_strength_pa", body.yield_strength_max,
                 name + ".yield_strength_max_pa");
    constexpr double kMostRatio = 1.3;  // measured constants of one metal agree better
    const double derived = body.conductivity / (body.density * body.specific_heat);
    if (std::abs(std::log(body.diffusivity / derived)) > std::log(kMostRatio))
      warnings.push_back(
          fmt::format("{0}.thermal_diffusivity_m2_per_s = {1} m2 s-1 contradicts conductivity / (density "
                      "* specific heat) = {2:.3g} m2 s-1: correct one of the four, or leave it out",
                      name, scene::number_text(body.diffusivity), derived));
  };
  check_body(options.soft, "soft");
  check_body(options.hard, "hard");
  if (options.junctions)
    ends_below(options.interface.yield_strength, "interface.yield_strength_pa",
               options.junctions->metal.yield_strength_max, "junctions.yield_strength_max_pa");
  const v1::Interface& law = scene.interface();
  if (law.friction_coefficient_fast() > law.friction_coefficient())
    warnings.push_back(fmt::format(
        "interface.friction_coefficient_fast = {} is above interface.friction_coefficient = "
        "{}: friction grows with velocity. Are they swapped?",
        scene::number_text(law.friction_coefficient_fast()), scene::number_text(law.friction_coefficient())));
}

// What a user should know about the tables of a scene or of one of its pairs.
std::vector<std::string> warnings_of(const v1::Scene& scene, const physics::ModelOptions& options) {
  std::vector<std::string> warnings;
  if (const auto caution = physics::caution_of(scene.soft().material(), options.soft); !caution.empty())
    warnings.push_back(
        fmt::format("soft.material = \"{}\": {}. If you have hot data, give {} constants of your own in [soft], or "
                    "another flow_law",
                    scene.soft().material(), caution, physics::FlowLaws::name_of(options.soft.flow_law)));
  if (std::string warning = strength_warning(scene, options); !warning.empty()) warnings.push_back(std::move(warning));
  add_contradictions(scene, options, warnings);
  return warnings;
}

// Converts a checked scene without its pairs, whose defaults have been filled in. Also fills in the constants that the
// scene leaves to the server.
SceneModel convert_tables(v1::Scene& scene) {
  if (wire::has_control_character(scene.name()))
    refuse("name", "name has a control character, expected printable text of one line", "Choose another name.");
  SceneModel made{.name = scene.name()};
  physics::ModelOptions& options = made.options;
  options.soft = material_of(scene.soft(), "soft");
  options.hard = material_of(scene.hard(), "hard");
  options.heat_tables = heat_tables_of(scene, options);
  options.strategy = scene.strategy() == v1::STRATEGY_FORCE_DRIVEN ? physics::Strategy::kForceDriven
                                                                   : physics::Strategy::kVelocityDriven;
  options.tangential_components = static_cast<int>(scene.tangential_components());
  set_layer(scene.layer(), options);
  const v1::VelocityDriven& driven = scene.velocity_driven();
  options.drive =
      driven.drive() == v1::DRIVE_INTERFACE_SLIP ? physics::Drive::kInterfaceSlip : physics::Drive::kLayerShear;
  options.friction_coefficient = friction_coefficient_of(scene);
  options.taylor_quinney_factor = taylor_quinney_factor_of(scene);
  if (scene.has_interface()) options.interface = interface_of(scene.interface());
  options.plastic_layer = scene.interface().plastic_layer();
  if (scene.has_hard_layer()) {
    fill_hard_layer(scene, options);
    options.hard_grid = grid_of(scene.hard_layer());
  }
  if (scene.has_junctions()) {
    fill_junctions(*scene.mutable_junctions(), options.soft);
    options.junctions = junctions_of(scene.junctions(), options);
  }
  if (scene.has_melt_film()) {
    const v1::MeltFilm& film = scene.melt_film();
    options.melt_film = physics::MeltFilmOptions{.latent_heat = film.latent_heat_j_per_kg(),
                                                 .viscosity = film.viscosity_pa_s(),
                                                 .activation_energy = film.activation_energy_j_per_mol()};
  }
  if (scene.has_tolerance()) {
    options = physics::discretised(options, scene.tolerance());
    if (!scene.has_work_budget()) scene.set_work_budget(physics::kWorkBudget);
    options.work_budget = scene.work_budget();
  } else if (scene.has_work_budget()) {
    refuse("work_budget",
           "work_budget goes with a tolerance, which divides steps: without one no step is divided freely",
           "Leave it out, or give a tolerance.");
  }
  refuse_what_excludes_each_other(options);
  made.friction_energy = scene.friction_energy();
  if (made.friction_energy && !has_ledger(options))
    refuse(
        "friction_energy",
        "friction_energy sums the energy ledger, which a layer with inertia or with an isothermal face does not have",
        "Leave it out.");
  scene::set_numbers(physics::constants_of(options.soft), *scene.mutable_soft());
  scene::set_numbers(physics::constants_of(options.hard), *scene.mutable_hard());
  if (options.strategy == physics::Strategy::kForceDriven) scene.clear_velocity_driven();
  return made;
}

// Whether pairs of one scene may differ in a key: in constants and in the laws of a material and of the interface, not
// in what adds states or columns or divides the step.
bool may_differ(std::string_view path, bool is_number) {
  constexpr std::string_view kWords[] = {"material", "flow_law", "melting_curve", "pressure_term", "friction_law"};
  constexpr std::string_view kNumbers[] = {"layer.thickness_m", "layer.initial_temperature_k", "hard_layer.thickness_m",
                                           "velocity_driven.friction_coefficient",
                                           "velocity_driven.taylor_quinney_factor"};
  const std::string_view table = path.substr(0, path.find('.'));
  const bool of_law = table == "soft" || table == "hard" || table == "interface" || table == "junctions";
  if (of_law && is_number) return true;
  return (of_law && std::ranges::count(kWords, path.substr(path.find('.') + 1)) != 0) ||
         std::ranges::count(kNumbers, path) != 0;
}

void refuse_molten_start(const physics::ModelOptions& options) {
  if (options.initial_temperature < options.soft.melting_temperature) return;
  refuse("layer.initial_temperature_k",
         fmt::format("layer.initial_temperature_k = {} K is not below soft.melting_temperature_k = {} K: the layer "
                     "starts solid",
                     scene::number_text(options.initial_temperature),
                     scene::number_text(options.soft.melting_temperature)),
         "Correct one of the two, in K.");
}

// Refuses a pair whose layer has other options or other states than the scene's. Returns the warnings of its model.
std::vector<std::string> check_shape(const v1::Scene& scene, const physics::Model& model, const v1::Scene& whole,
                                     const physics::ModelOptions& of_pair, const std::string& table) {
  const physics::ModelOptions& options = model.options();
  const std::string remedy = "Open a session of its own for nodes with other options.";
  std::string key = scene::first_difference(scene, whole, may_differ);
  if (options.friction_coefficient.has_value() != of_pair.friction_coefficient.has_value())
    key = "velocity_driven.friction_coefficient";
  if (options.taylor_quinney_factor.has_value() != of_pair.taylor_quinney_factor.has_value())
    key = physics::key_of(physics::part_of(physics::Property::kPlasticHeating), options);
  if (!key.empty())
    refuse(table + "." + key,
           fmt::format("{0}.{1} differs from the scene's {1}: pairs of one session differ in constants, not in options",
                       table, key),
           remedy);
  const physics::Model model_of_pair(of_pair);
  if (!shard::same_states(model, model_of_pair))
    refuse(table,
           fmt::format("the layer of [{}] has other states than the scene's: {}", table,
                       options.tolerance ? "the tolerance chooses its cells by its constants"
                       : options.modes   ? "the number of heat modes follows from its constants"
                                         : "its vertices follow from its constants"),
           options.tolerance || options.modes
               ? "Give cells and grading in place of a tolerance, and a profile in place "
                 "of modes; or open a session of its own for the pair."
               : remedy);
  return model_of_pair.warnings();
}

// Adds the table of a pair to the keys that are at fault in the scene that the pair makes.
Refused of_pair(const Refused& refused, const v1::Pair& pair) {
  const std::string name = "pair." + pair.name();
  Refused found{{}, refused.remedy};
  for (const scene::Fault& fault : refused.faults)
    found.faults.push_back({name + "." + fault.path, fmt::format("[{}]: {}", name, fault.text), {}});
  return found;
}

// Adds the pairs of a scene to the model of the tables outside, and fills in their constants. `given` is the scene as it
// was given, without its pairs.
void add_pairs(const v1::Scene& given, v1::Scene& scene, SceneModel& made) {
  if (scene.pair().empty()) return;
  const v1::Scene outside = scene::without_pairs(scene);  // with all constants
  const physics::Model outside_model(made.options);
  const auto is_given_for_the_scene = [&](const std::string& warning) {
    return std::ranges::count(made.warnings, warning) + std::ranges::count(outside_model.warnings(), warning) != 0;
  };
  for (v1::Pair& pair : *scene.mutable_pair()) {
    v1::Scene whole = scene::scene_of_pair(given, pair);
    scene::fill_defaults(whole);
    try {
      const SceneModel model = convert_tables(whole);
      refuse_molten_start(model.options);
      std::vector<std::string> warnings =
          check_shape(outside, outside_model, whole, model.options, "pair." + pair.name());
      std::ranges::copy(warnings_of(whole, model.options), std::back_inserter(warnings));
      std::erase_if(warnings, is_given_for_the_scene);
      made.pairs.push_back({pair.name(), model.options, std::move(warnings)});
    } catch (const Refused& refused) {
      if (refused.faults.front().path.starts_with("pair.")) throw;
      throw of_pair(refused, pair);
    }
    scene::set_pair(outside, whole, pair);
  }
}

// Clears the diffusivities that are as the server derives them, also those of an effective scene that comes back: they
// draw no warning beside those of their constants.
template <typename Tables>  // a scene or a pair
void clear_derived(Tables& tables) {
  for (v1::Body* body : {tables.mutable_soft(), tables.mutable_hard()})
    if (body->thermal_diffusivity_m2_per_s() ==
        body->thermal_conductivity_w_per_m_k() / (body->density_kg_per_m3() * body->specific_heat_j_per_kg_k()))
      body->clear_thermal_diffusivity_m2_per_s();
}

// Converts a checked scene.
SceneModel convert(v1::Scene& scene, bool warn) {
  const v1::Scene given = scene::without_pairs(scene);
  SceneModel made = convert_tables(scene);
  if (warn) {  // parameters of nodes are judged with the temperatures that the nodes bring (validate.cpp)
    refuse_molten_start(made.options);
    made.warnings = warnings_of(scene, made.options);
  }
  add_pairs(given, scene, made);
  made.effective = scene::to_toml(scene);
  if (!made.pairs.empty() && made.effective.size() > wire::kMaxSceneBytes)
    refuse("pair",
           fmt::format("the scene with all constants of its pairs has {} bytes, at most {} are allowed",
                       made.effective.size(), wire::kMaxSceneBytes),
           "Divide the pairs over several sessions.");
  made.scene = std::make_shared<v1::Scene>(scene);
  if (warn) {
    clear_derived(scene);
    for (v1::Pair& pair : *scene.mutable_pair()) clear_derived(pair);
    std::ranges::copy(scene::unusual_values(scene), std::back_inserter(made.warnings));
  }
  return made;
}

}  // namespace

bool has_ledger(const physics::ModelOptions& options) {
  const auto leaves = [](const physics::GridOptions& grid) {
    return grid.far_boundary == physics::FarBoundary::kIsothermal;
  };
  return !options.inertia && !leaves(options.grid) && !(options.hard_grid && leaves(*options.hard_grid));
}

// Adds materials that the catalog lacks to the other faults of a scene. One that is the only fault is left to convert(),
// which has a remedy.
static void add_unknown_materials(const v1::Scene& scene, scene::Findings& findings) {
  std::vector<scene::Fault> unknown;
  const auto look = [&](const v1::Body& body, const std::string& table) {
    const std::string path = table + ".material";
    if (body.material().empty() || !findings.sound(path)) return;
    const physics::MaterialResult made = physics::make_material(body.material(), {});
    if (made.fault_field == "material")
      unknown.push_back({path, fmt::format("{}: {}", path, wire::printable(made.fault, wire::kMaxTextBytes)), {}});
  };
  look(scene.soft(), "soft");
  look(scene.hard(), "hard");
  for (const v1::Pair& pair : scene.pair()) {
    look(pair.soft(), "pair." + pair.name() + ".soft");
    look(pair.hard(), "pair." + pair.name() + ".hard");
  }
  if (findings.faults().empty() && unknown.size() < 2) return;
  for (scene::Fault& fault : unknown) findings.add(std::move(fault.path), std::move(fault.text));
}

SceneModel scene_model(std::string_view text, const std::string& file) {
  return wire::with_message<v1::Scene>([&](v1::Scene& message) {
    const scene::Document document = scene::read(text, file, message, add_unknown_materials);
    try {
      return convert(message, true);
    } catch (const Refused& refused) {
      document.refuse(refused.faults, refused.remedy);
    }
  });
}

SceneModel scene_model(const v1::Scene& given, bool warn) {
  return wire::with_message<v1::Scene>([&](v1::Scene& message) {
    message = given;
    Refused refused{scene::faults_of(message), {}};
    try {
      if (refused.faults.empty()) return convert(message, warn);
    } catch (Refused& found) {
      refused = std::move(found);
    }
    std::vector<std::string> lines;
    for (const scene::Fault& fault : refused.faults) lines.push_back(fault.text);
    throw wire::Error({.code = wire::Code::kInvalidScene,
                       .text = fmt::format("{}", fmt::join(lines, "\n")),
                       .remedy = refused.remedy,
                       .field = refused.faults.front().path});
  });
}

std::string_view layers_of(std::string_view effective) {
  for (const std::string_view key : {"name = ", "source = "})
    if (effective.starts_with(key)) effective.remove_prefix(effective.find('\n') + 1);
  return effective;
}

}  // namespace shearbus::service
