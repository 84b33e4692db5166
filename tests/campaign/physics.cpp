// The list of physics of the stability campaign: chosen combinations of options, and in addition every option and every
// law that none of these combinations has.
#include <algorithm>
#include <functional>
#include <string>

#include "tests/campaign/campaign.hpp"
#include "tests/support/combinations.hpp"

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs of tests/support

namespace {

// For each strategy, adds a physics for every option and every law that no physics of the strategy has yet. An option
// that is invalid alone is combined with one more option.
void add_missing(const std::function<ModelOptions(Strategy)>& base, std::vector<Physics>& all) {
  const std::vector<Item> list = items();
  for (const Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven})
    for (const Item& item : list) {
      ModelOptions alone = base(strategy);
      item.apply(alone);
      const auto has = [&](const Physics& physics) {
        const ModelOptions& o = physics.options;
        if (o.strategy != strategy) return false;
        if (item.kind == Kind::kFlowLaw) return o.soft.flow_law == alone.soft.flow_law;
        if (item.kind == Kind::kFrictionLaw) return o.interface.friction_law == alone.interface.friction_law;
        for (const Part& part : parts())
          if (unique_key(part) == item.name && part.set != nullptr) return part.is_on(o);
        return false;
      };
      if (std::any_of(all.begin(), all.end(), has)) continue;
      for (std::size_t companion = 0; companion <= list.size(); ++companion) {
        ModelOptions options = base(strategy);
        if (item.kind == Kind::kFrictionLaw) options.interface.friction_coefficient = 0.02;
        item.apply(options);
        std::string name = (strategy == Strategy::kForceDriven ? "force, " : "velocity, ") + item.name;
        if (companion > 0) {
          list[companion - 1].apply(options);
          name += " with " + list[companion - 1].name;
        }
        if (options.tolerance) options = discretised(options, 1e-2);
        if (!refusals(options).empty() || !has({name, options})) continue;
        all.push_back({name, options});
        break;
      }
    }
}

}  // namespace

std::vector<Physics> all_physics() {
  const auto base = [](Strategy strategy) {
    ModelOptions o = graded(paper_options(strategy), 40, 1.12);
    o.grid.far_boundary = FarBoundary::kHalfSpace;
    return o;
  };
  const auto under_pressure = [](ModelOptions o) {
    o.soft.melting_curve = MeltingCurve::kLindemann;
    o.soft.pressure_term = PressureTerm::kCompressed;
    return o;
  };
  const auto johnson_cook = [](ModelOptions o) {
    follow_johnson_cook(o.soft, 426e6, 0.015, 1.0, 1.0, 300.0);
    o.soft.hardening_exponent = 0.34;
    return o;
  };
  const auto preston = [](ModelOptions o) {
    adopt_flow_law(o.soft, preston_tonks_wallace_constants());
    return o;
  };
  const auto in_two_directions = [](ModelOptions o) {
    o.tangential_components = 2;
    return o;
  };
  const ModelOptions velocity = base(Strategy::kVelocityDriven);
  const ModelOptions force = base(Strategy::kForceDriven);

  ModelOptions interface_slip = velocity;
  interface_slip.drive = Drive::kInterfaceSlip;
  ModelOptions friction = velocity;
  friction.friction_coefficient = 0.02;
  ModelOptions plastic_heating = two_sided(velocity);
  plastic_heating.taylor_quinney_factor = 0.9;
  ModelOptions inertia = velocity;
  inertia.inertia = true;
  ModelOptions waves_that_heat = plastic_heating;
  waves_that_heat.inertia = true;
  ModelOptions waves_and_friction = under_pressure(friction);
  waves_and_friction.inertia = true;
  ModelOptions waves_and_junctions = inertia;
  waves_and_junctions.friction_coefficient = 0.02;
  waves_and_junctions.interface = {.friction_coefficient = 0.02,
                                   .yield_strength = 200e6,
                                   .friction_law = FrictionLaws::place<RateAndState>(),
                                   .slip_length = 1e-6,
                                   .reference_velocity = 1.0,
                                   .direct_effect = 4e-4,
                                   .evolution_effect = 6e-4};
  waves_and_junctions.junctions = {0.5, 1e-7, inertia.soft};
  ModelOptions waves_all = two_sided(waves_and_junctions);
  waves_all.taylor_quinney_factor = 0.9;

  ModelOptions insulated = force;
  insulated.grid.far_boundary = FarBoundary::kInsulated;
  ModelOptions plastic_layer = force;
  plastic_layer.plastic_layer = true;
  plastic_layer.interface.yield_strength = 400e6;
  ModelOptions junctions = force;
  junctions.junctions = {0.5, 1e-7, force.soft};
  ModelOptions flowing_junctions = plastic_layer;
  flowing_junctions.junctions = junctions.junctions;
  flowing_junctions.junctions->metal.yield_strength = plastic_layer.interface.yield_strength;
  ModelOptions forced_waves = plastic_layer;
  forced_waves.inertia = true;
  ModelOptions forced_waves_and_junctions = under_pressure(two_sided(flowing_junctions));
  forced_waves_and_junctions.inertia = true;
  ModelOptions forced_waves_that_heat = forced_waves_and_junctions;
  forced_waves_that_heat.taylor_quinney_factor = 0.9;
  ModelOptions work_heats = two_sided(flowing_junctions);
  work_heats.taylor_quinney_factor = 0.9;
  ModelOptions weakening = force;
  weakening.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
  weakening.interface.friction_coefficient = 0.02;
  weakening.interface.friction_coefficient_fast = 0.002;
  weakening.interface.velocity_decay = 0.01;
  ModelOptions flowing_weakening = weakening;
  flowing_weakening.plastic_layer = true;
  const auto second_order = [](ModelOptions o) {
    o.time_integrator = TimeIntegrator::kSdirk2;
    return o;
  };
  const auto melting = [](ModelOptions o) {
    o.melt_film = MeltFilmOptions{.latent_heat = 397e3, .viscosity = 1.25e-3, .activation_energy = 16.5e3};
    return o;
  };
  ModelOptions modes = force;
  modes.modes = {.accuracy = 1e-4, .shortest_step = 1e-12, .longest_time = 1e-3};
  ModelOptions slab_modes = modes;
  slab_modes.grid.far_boundary = FarBoundary::kInsulated;

  const auto to_a_tolerance = [](const ModelOptions& o) { return discretised(o, 1e-2); };
  const auto sleeping = [](ModelOptions o) {
    o.sleep = true;
    return o;
  };

  std::vector<Physics> all = {{"layer shear", velocity},
                              {"interface slip", interface_slip},
                              {"Coulomb limit", friction},
                              {"two-sided", two_sided(velocity)},
                              {"plastic heating", plastic_heating},
                              {"inertia", inertia},
                              {"inertia, Coulomb, T_melt(P)", waves_and_friction},
                              {"inertia, rate and state, junctions", waves_and_junctions},
                              {"inertia, plastic heating", waves_that_heat},
                              {"inertia, plastic heating, rate and state, junctions", waves_all},
                              {"T_melt(P), compressed", under_pressure(velocity)},
                              {"Johnson-Cook", johnson_cook(velocity)},
                              {"Preston-Tonks-Wallace", preston(velocity)},
                              {"Preston, two-sided, T_melt(P)", preston(two_sided(under_pressure(velocity)))},
                              {"two components", in_two_directions(velocity)},
                              {"second order", second_order(velocity)},
                              {"tolerance", to_a_tolerance(velocity)},
                              {"Johnson-Cook, tolerance", to_a_tolerance(johnson_cook(velocity))},
                              {"Preston, tolerance", to_a_tolerance(preston(velocity))},
                              {"sleep", sleeping(velocity)},
                              {"Preston, sleep", sleeping(preston(velocity))},
                              {"force-driven", force},
                              {"force, insulated", insulated},
                              {"force, plastic layer", plastic_layer},
                              {"force, inertia", forced_waves},
                              {"force, inertia, two-sided, junctions, T_melt(P)", forced_waves_and_junctions},
                              {"force, inertia, junctions, T_melt(P), work heats", forced_waves_that_heat},
                              {"force, junctions", junctions},
                              {"force, weakening", weakening},
                              {"force, two-sided", two_sided(force)},
                              {"force, melt film", melting(two_sided(force))},
                              {"force, melt film, T_melt(P)", melting(two_sided(under_pressure(force)))},
                              {"force, T_melt(P), plastic layer", under_pressure(plastic_layer)},
                              {"force, Johnson-Cook", johnson_cook(force)},
                              {"force, Johnson-Cook, plastic layer", johnson_cook(plastic_layer)},
                              {"force, Preston, plastic layer", preston(plastic_layer)},
                              {"force, Preston, two components", in_two_directions(preston(plastic_layer))},
                              {"force, second order", second_order(force)},
                              {"force, modes", modes},
                              {"force, modes of a slab, 2nd order", second_order(slab_modes)},
                              {"force, two components", in_two_directions(force)},
                              {"force, tolerance", to_a_tolerance(force)},
                              {"force, two-sided, tolerance", to_a_tolerance(two_sided(force))},
                              {"force, sleep", sleeping(force)},
                              {"force, two-sided, sleep", sleeping(two_sided(force))},
                              {"force, plastic layer, tolerance", to_a_tolerance(plastic_layer)},
                              {"force, plastic layer, sleep", sleeping(plastic_layer)},
                              {"force, plastic layer, weakening", flowing_weakening},
                              {"force, plastic layer, junctions, work heats", work_heats},
                              {"force, junctions, work heats, sleep", sleeping(work_heats)},
                              {"force, all of it", in_two_directions(two_sided(under_pressure(plastic_layer)))}};
  add_missing(base, all);
  return all;
}

}  // namespace shearbus::study::stability
