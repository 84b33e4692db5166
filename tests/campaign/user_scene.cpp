#include "tests/campaign/user_scene.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "hydro_stub/cone_target.hpp"
#include "hydro_stub/problem.hpp"
#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/service/scene_model.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::study {

using physics::ModelOptions;
using stability::Host;

namespace {

[[noreturn]] void refuse(std::string field, std::string text, std::string remedy) {
  throw wire::Error({.code = wire::Code::kInvalidScene,
                     .text = std::move(text),
                     .remedy = std::move(remedy),
                     .field = std::move(field)});
}

// Returns true for those problems of shearbus-hydro in which bodies with an interface law slide on each other.
bool has_interface(const guest::Hydro& hydro) {
  return hydro.has_shear_column() || hydro.has_cone_target() || hydro.has_sliding_plates();
}

void require_layer(const guest::HydroScene& scene) {
  if (scene.has_hydro() && !has_interface(scene.hydro()))
    refuse("hydro", "expected a scene with a shear layer, found a problem in which no bodies slide on each other",
           "Give a scene with shear_column, cone_target or sliding_plates, or without [hydro].");
  if (scene.has_hydro() && scene.hydro().interface_law() != guest::INTERFACE_LAW_SUBGRID)
    refuse("hydro.interface_law",
           fmt::format("expected interface_law \"subgrid\", found \"{}\": it keeps no shear layer",
                       hydro::name(scene.hydro().interface_law())),
           "Let it be \"subgrid\", with strategy and [interface].");
  if (scene.scene().strategy() == v1::STRATEGY_UNSPECIFIED)
    refuse("strategy", "expected a scene with a shear layer, found one without strategy",
           "Set strategy = \"velocity_driven\" or \"force_driven\".");
}

// Opens a session for the scene in a server inside this process. Throws the server's error if it refuses the scene.
void require_opened(const hydro::SceneFile& file) {
  support::ServiceHarness host;
  wire::Request opening = support::ServiceHarness::opening(file.server_text(), support::node_ids(1));
  std::get<wire::OpenSession>(opening.body).scene_file = file.document.file;
  const support::Answer answer = host.ask(opening);
  if (answer.code() != wire::Code::kOk) throw wire::Error(answer.reply.status);
}

// ---- The properties of the host for a scene ----

struct Told {
  Host host;
  std::string by;
};

// Returns the properties of the host (pressure, zone widths, step length) for the hydrocode problem in the scene, or
// those of the paper if the scene has no such problem. A shear_column determines all of them. The problems in two
// dimensions have one zone width; their step length is the Courant limit of a longitudinal wave in the faster metal.
Told host_of(const guest::HydroScene& scene) {
  Told told{.host = {}, .by = "not in the scene: the paper's"};
  if (!scene.has_hydro()) return told;
  Host& host = told.host;
  const auto in_two_dimensions = [&](double width, double courant, const hydro::Metal& soft, const hydro::Metal& hard) {
    host.half_zone_soft = host.half_zone_hard = 0.5 * width;
    const auto speed = [](const hydro::Metal& metal) {
      const double bulk = metal.eos.sound_speed;
      return std::sqrt(bulk * bulk + 4.0 / 3.0 * metal.strength.shear_modulus / metal.eos.density);
    };
    host.dt = courant * width / std::max(speed(soft), speed(hard));
  };
  if (scene.hydro().has_shear_column()) {
    const hydro::ColumnProblem problem = hydro::make_problem(scene);
    host = {.pressure = *std::ranges::max_element(scene.hydro().shear_column().pressure_pa()),
            .half_zone_soft = 0.5 * problem.soft.zone_width,
            .half_zone_hard = 0.5 * problem.hard.zone_width,
            .dt = problem.dt};
    told.by = "[hydro.shear_column]";
  } else if (scene.hydro().has_cone_target()) {
    const hydro::ConeTarget cone = hydro::make_cone_target(scene);
    in_two_dimensions(cone.scene.zone_width_m(), cone.scene.courant(), cone.soft, cone.hard);
    // The flyer consists of the same metal as the confinement that it strikes. The pressure of the impact is therefore
    // the Hugoniot pressure at a particle velocity of half the flyer's speed.
    const double u = 0.5 * cone.scene.flyer_speed_m_per_s();
    host.pressure = cone.hard.eos.density * (cone.hard.eos.sound_speed + cone.hard.eos.s1 * u) * u;
    told.by = "[hydro.cone_target]";
  } else {
    const guest::SlidingPlates& plates = scene.hydro().sliding_plates();
    in_two_dimensions(plates.zone_width_m(), lagrange::TimeStepOptions{}.cfl,
                      hydro::make_metal(scene.scene().soft(), "soft"), hydro::make_metal(scene.scene().hard(), "hard"));
    host.pressure = plates.pressure_pa();
    told.by = "[hydro.sliding_plates]";
  }
  return told;
}

Told host_of(const guest::HydroScene& scene, const HostGiven& given) {
  Told told = host_of(scene);
  std::vector<std::string> options;
  if (given.pressure) {
    told.host.pressure = *given.pressure;
    options.emplace_back("--pressure");
  }
  if (given.zone_width) {
    told.host.half_zone_soft = told.host.half_zone_hard = 0.5 * *given.zone_width;
    options.emplace_back("--zone-width");
  }
  if (given.dt) {
    told.host.dt = *given.dt;
    options.emplace_back("--dt");
  }
  if (!options.empty()) told.by = fmt::format("{}, else {}", fmt::join(options, ", "), told.by);
  if (!(told.host.pressure > 0.0))
    refuse("hydro", fmt::format("expected a pressure above 0 at some time, found {} Pa at most", told.host.pressure),
           "An open contact tells nothing: give --pressure, in Pa.");
  return told;
}

// ---- The physics of a scene, described in words ----

std::string body(const v1::Body& body, const physics::Material& metal) {
  std::string text = body.material().empty() ? "a metal of its own" : body.material();
  if (!body.material().empty() && !scene::numbers_of(body).empty()) text += " with constants of its own";
  if (metal.flow_law != physics::FlowLaw{}) text += fmt::format(" ({})", physics::FlowLaws::name_of(metal.flow_law));
  if (metal.melting_curve != physics::MeltingCurve::kConstant) text += ", T_melt(P)";
  if (metal.pressure_term != physics::PressureTerm::kLinear) text += ", compressed";
  return text;
}

std::string law(const ModelOptions& o) {
  if (o.strategy == physics::Strategy::kVelocityDriven) {
    std::string text = o.drive == physics::Drive::kInterfaceSlip ? ", slip at z = 0" : "";
    if (o.friction_coefficient) text += fmt::format(", s <= {:g} P", *o.friction_coefficient);
    if (o.taylor_quinney_factor) text += fmt::format(", {:g} of the plastic work heats", *o.taylor_quinney_factor);
    return o.inertia ? text + ", with inertia" : text;
  }
  const physics::InterfaceOptions& law = o.interface;
  std::string text = fmt::format(", s <= {:g} P and {:g} MPa", law.friction_coefficient, 1e-6 * law.yield_strength);
  if (law.friction_law != physics::FrictionLaw{})
    text += fmt::format(" ({})", physics::FrictionLaws::name_of(law.friction_law));
  if (o.junctions) text += ", junctions";
  return o.plastic_layer ? text + ", the layer flows" : text;
}

std::string layer(const ModelOptions& o) {
  std::string text = fmt::format("{:g} um", 1e6 * o.grid.thickness);
  if (o.modes) {
    text += fmt::format(", no cells but {} modes", physics::Model(o).layout().num_heat_modes - 1);
  } else {
    text += fmt::format(" of {} cells growing by {:g}", o.grid.cells, o.grid.grading);
  }
  text += o.grid.far_boundary == physics::FarBoundary::kHalfSpace    ? ", half-space behind"
          : o.grid.far_boundary == physics::FarBoundary::kIsothermal ? ", far face at its temperature"
                                                                     : ", insulated";
  if (o.hard_grid) text += ", the hard body conducts";
  if (o.time_integrator == physics::TimeIntegrator::kSdirk2) text += ", second order";
  if (o.tolerance) text += fmt::format(", by a tolerance of {:g}", *o.tolerance);
  return o.sleep ? text + ", nodes at rest sleep" : text;
}

std::string describe(const v1::Scene& scene, const ModelOptions& o) {
  return fmt::format("{}{}: {} on {}{}; layer {}; T_ref {:g} K, melting at {:g} K",
                     o.strategy == physics::Strategy::kForceDriven ? "force-driven" : "velocity-driven",
                     o.tangential_components == 2 ? ", two components" : "", body(scene.soft(), o.soft),
                     body(scene.hard(), o.hard), law(o), layer(o), o.initial_temperature, o.soft.melting_temperature);
}

// Runs `work` and returns its result. If `work` throws a fault of the scene, adds its place in the file to the message.
template <class Work>
auto placed(const hydro::SceneFile& file, const Work& work) {
  try {
    return work();
  } catch (const wire::Error& error) {
    throw std::runtime_error(wire::describe(file.document.placed(error.status())));
  }
}

}  // namespace

hydro::SceneFile load_scene_with_layer(const std::filesystem::path& path) {
  hydro::SceneFile file = hydro::load_scene(path);
  placed(file, [&] {
    require_layer(file.scene);
    require_opened(file);
  });
  return file;
}

UserScene user_scene(const hydro::SceneFile& file, const HostGiven& given) {
  return placed(file, [&] {
    const v1::Scene& scene = file.scene.scene();
    const ModelOptions options = service::scene_model(scene).options;
    const auto [host, by] = host_of(file.scene, given);
    return UserScene{
        .physics = {.name = scene.name(), .options = options, .host = host},
        .text = describe(scene, options),
        .host = fmt::format("{:.4g} GPa, zones of {:.4g} and {:.4g} um, steps of {:.4g} ns ({})", 1e-9 * host.pressure,
                            2e6 * host.half_zone_soft, 2e6 * host.half_zone_hard, 1e9 * host.dt, by)};
  });
}

}  // namespace shearbus::study
