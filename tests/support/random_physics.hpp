// Random scenes and inputs, also extreme ones, for property tests and the stability campaign. The same seed gives the
// same scenes and inputs.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "server/physics/solver/flow/layer_flow.hpp"
#include "server/physics/solver/parts.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}
  double uniform(double lo, double hi) { return std::uniform_real_distribution<double>(lo, hi)(random_); }
  double log_uniform(double lo, double hi) { return std::exp(uniform(std::log(lo), std::log(hi))); }
  double sign() { return uniform(-1.0, 1.0) < 0.0 ? -1.0 : 1.0; }
  bool chance(double p) { return uniform(0.0, 1.0) < p; }
  int integer(int lo, int hi) { return std::uniform_int_distribution<int>(lo, hi)(random_); }

 private:
  std::mt19937_64 random_;
};

// Gives the metal Johnson and Cook's flow law. Constants of other laws become NaN, so that their use would give NaN.
inline void follow_johnson_cook(Material& m, double B, double C, double rate, double exponent, double T_ref) {
  m.flow_law = FlowLaws::place<JohnsonCook>();
  m.hardening_modulus = B;
  m.rate_coefficient = C;
  m.reference_strain_rate = rate;
  m.thermal_exponent = exponent;
  m.reference_temperature = T_ref;
  m.pressure_term = PressureTerm::kLinear;
  m.yield_strength_max = m.hardening_coefficient = m.pressure_coefficient = m.temperature_coefficient = kNotGiven;
}

// Gives the metal `m` the flow law of `from`, with all constants of that law. Constants of other flow laws become NaN.
inline void adopt_flow_law(Material& m, const Material& from) {
  const Material own = m;
  for (const MaterialField& field : material_fields()) {
    const bool of_a_law = FlowLaws::any(
        [&](auto law) { return has_constant(FlowLaws::place<typename decltype(law)::type>(), field.value); });
    if (of_a_law) m.*field.value = has_constant(from.flow_law, field.value) ? from.*field.value : kNotGiven;
  }
  m.flow_law = from.flow_law;
  m.pressure_term = properties_of(from.flow_law).has_pressure_term ? own.pressure_term : PressureTerm::kLinear;
}

// Returns test constants of the Preston-Tonks-Wallace law. They resemble those for copper but describe no real metal.
inline Material preston_tonks_wallace_constants() {
  Material m;
  m.flow_law = FlowLaws::place<PrestonTonksWallace>();
  m.molar_mass = 0.0635;
  m.work_hardening_rate = 0.025;
  m.work_hardening_curvature = 2.0;
  m.saturation_cold = 0.0085;
  m.saturation_hot = 0.00055;
  m.yield_cold = 2e-4;
  m.yield_hot = 1e-4;
  m.activation = 0.11;
  m.attempt_rate = 1e-5;
  m.medium_rate_yield = 0.094;
  m.medium_rate_exponent = 0.575;
  m.overdriven_exponent = 0.25;
  m.modulus_temperature = 0.2;
  m.pressure_coefficient = 2.83e-11;
  return m;
}

inline Material random_preston_tonks_wallace(Draw& draw) {
  Material m = preston_tonks_wallace_constants();
  m.work_hardening_rate = draw.log_uniform(5e-3, 0.1);
  m.work_hardening_curvature = draw.chance(0.3) ? 0.0 : draw.uniform(0.1, 10.0);
  m.saturation_cold = draw.log_uniform(3e-3, 0.05);
  m.saturation_hot = m.saturation_cold * draw.log_uniform(0.02, 1.0);
  m.yield_cold = m.saturation_cold * draw.log_uniform(0.01, 1.0);
  m.yield_hot = std::min(m.yield_cold, m.saturation_hot) * draw.log_uniform(0.05, 1.0);
  m.activation = draw.log_uniform(0.02, 0.6);
  m.attempt_rate = draw.log_uniform(1e-7, 1e-2);
  m.medium_rate_yield = m.saturation_cold * draw.log_uniform(1.0, 20.0);
  m.overdriven_exponent = draw.uniform(0.1, 0.5);
  m.medium_rate_exponent = m.overdriven_exponent + draw.uniform(0.0, 0.5);
  m.modulus_temperature = draw.uniform(0.0, 0.6);
  return m;
}

// Returns a lower bound of the sensitivity d ln(stress) / d ln(dep) of the stress to the plastic strain increment dep.
inline double flow_exponent(const Material& m) {
  const auto least = [&](std::initializer_list<double Material::*> exponents) {
    double exponent = 1.0;
    for (double Material::*each : exponents) {
      if (has_constant(m.flow_law, each) && m.*each > 0.0) exponent = std::min(exponent, m.*each);
    }
    return exponent;
  };
  return least({&Material::hardening_exponent, &Material::rate_coefficient, &Material::overdriven_exponent});
}

// Returns the scale of strains in the flow law. Rounding errors of strain differences are relative to this scale or to
// the plastic strain, whichever is larger.
inline double strain_scale(const Material& m) {
  return has_constant(m.flow_law, &Material::hardening_coefficient) ? 1.0 / m.hardening_coefficient : 1.0;
}

// Relative rounding error that the checks allow for a stress or a temperature: 16 ulps.
inline constexpr double kDigits = 16.0 * std::numeric_limits<double>::epsilon();

// Relative error of the searches for the strain of each vertex, with which a flow that depends on its rate is summed
// (solver/flow/layer_flow.cpp). The balance of a step is closed to another of the same size.
inline constexpr double kSearchedDigits = 1e-14;

// Returns the uncertainty of a layer's flow, the integral of the plastic strain increment [m]: the change of the flow
// if stress and temperatures change in their last digits. Near melting, or if strain follows a high power of the
// stress, no answer is more accurate. `grain` [K] is an additional error of the temperatures.
inline double flow_grain(const Rig& rig, const std::vector<double>& ep_old, double stress, int lane, double dt,
                         double grain = 0.0) {
  if (!hardens(rig.model.options().soft)) return 0.0;
  const Grid& grid = rig.model.grid();
  const double P = rig.inputs.pressure[lane];
  const Material soft = at_pressure(rig.model.options().soft, P);
  const std::vector<double> no_response(grid.num_vertices(), 0.0);
  const std::vector<double> profile = rig.layer_temperatures(lane);
  const double searched = properties_of(soft.flow_law).depends_on_rate ? kSearchedDigits : kDigits;
  const auto flow = [&](double sign) {
    const double scale = 1.0 + sign * kDigits, shift = sign * grain;
    std::vector<double> T(place(0, grid.num_vertices(), 0)), ep(T.size());
    for (int i = 0; i < grid.num_vertices(); ++i) {
      T[i * kLanes + lane] = profile[i] * scale + shift;
      ep[i * kLanes + lane] = ep_old[i];
    }
    std::vector<double> rows(LayerFlow::size_of_rows(grid)), ep_new(T.size());
    LayerFlow sums({&soft, &grid, no_response.data(), T.data(), ep.data(), dt}, rows.data());
    sums.load(lane, soft, P, std::abs(stress) * (1.0 + sign * searched), 0.0);
    sums.sum(1u << lane, ep_new.data());
    return sums.slip[lane];
  };
  return flow(1.0) - flow(-1.0);
}

// Draws junctions or velocity weakening, which exclude each other, or neither.
inline void draw_contact(Draw& draw, bool extreme, ModelOptions& options) {
  const Material& soft = options.soft;
  const double part = draw.uniform(0.0, 1.0);
  if (part < 1.0 / 3.0) {
    Material metal = soft;
    metal.flow_law = FlowLaws::place<SteinbergCochranGuinan>();
    metal.yield_strength = options.interface.yield_strength;
    metal.yield_strength_max =
        draw.chance(0.5) ? metal.yield_strength * draw.uniform(0.9, 4.0) : std::numeric_limits<double>::infinity();
    metal.hardening_coefficient = draw.chance(0.2) ? 0.0 : draw.log_uniform(0.1, 1000.0);
    metal.hardening_exponent = draw.uniform(0.01, 1.0);
    options.junctions = {draw.chance(0.3) ? 1.0 : draw.log_uniform(1e-3, 1.0),
                         draw.log_uniform(extreme ? 1e-12 : 1e-9, 1e-5), metal};
  } else if (part > 2.0 / 3.0) {
    options.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
    options.interface.friction_coefficient_fast = options.interface.friction_coefficient * draw.uniform(0.0, 1.5);
    options.interface.velocity_decay = draw.chance(0.1) ? 0.0 : draw.log_uniform(1e-3, 1.0);
  }
}

// Draws friction that softens with the temperature.
inline void draw_softening(Draw& draw, ModelOptions& options) {
  options.interface.friction_law = FrictionLaws::place<ThermalSoftening>();
  options.interface.friction_reference_temperature = draw.uniform(1.0, 1200.0);
  options.interface.friction_softening_exponent = draw.chance(0.3) ? 1.0 : draw.uniform(1.0, 5.0);
}

// Draws constants of a friction law with a state.
inline void draw_state_law(Draw& draw, ModelOptions& options) {
  const double mu = options.strategy == Strategy::kForceDriven ? options.interface.friction_coefficient
                                                               : options.friction_coefficient.value_or(0.1);
  options.interface.slip_length = draw.log_uniform(1e-9, 1e-5);
  options.interface.reference_velocity = draw.log_uniform(1e-3, 10.0);
  options.interface.direct_effect = mu * draw.log_uniform(0.01, 0.1);
  options.interface.evolution_effect = options.interface.direct_effect * draw.uniform(0.0, 2.0);
  options.interface.state_evolution = draw.chance(0.5) ? StateEvolution::kSlip : StateEvolution::kAgeing;
  options.interface.friction_law =
      draw.chance(0.5) ? FrictionLaws::place<PrakashClifton>() : FrictionLaws::place<RateAndState>();
}

// Draws a contact beyond those of draw_contact(): laws with a state, junctions together with a law, and any law of a
// velocity-driven interface.
inline void draw_other_contact(Draw& draw, bool extreme, ModelOptions& options) {
  if (extreme && options.plastic_layer) return;  // as in random_options()
  if (options.strategy == Strategy::kVelocityDriven && options.friction_coefficient) {
    const double mu = *options.friction_coefficient;
    draw_contact(draw, extreme, options);
    options.interface.friction_coefficient_fast = mu * draw.uniform(0.0, 1.5);
    if (options.junctions || draw.chance(0.4))
      draw_state_law(draw, options);
    else if (draw.chance(0.3))
      draw_softening(draw, options);
  } else if (options.strategy == Strategy::kForceDriven && goes_with(Property::kFrictionWithState, options) &&
             goes_with(Property::kSlipDependentFriction, options) && draw.chance(0.4)) {
    draw_state_law(draw, options);
  }
}

inline ModelOptions random_options(Draw& draw, Strategy strategy, bool extreme) {
  ModelOptions options = paper_options(strategy);
  Material& soft = options.soft;
  soft.hardening_exponent = extreme ? draw.log_uniform(0.01, 1.0) : draw.uniform(0.05, 0.5);
  soft.hardening_coefficient = draw.chance(0.1) ? 0.0 : draw.log_uniform(1.0, 1000.0);
  soft.yield_strength = draw.log_uniform(50e6, 1e9);
  if (draw.chance(0.4)) soft.yield_strength_max = soft.yield_strength * draw.uniform(0.5, 5.0);
  if (draw.chance(0.4)) options.friction_coefficient = draw.log_uniform(0.01, 1.0);
  options.interface = {draw.log_uniform(0.01, 1.0), draw.log_uniform(50e6, 1e9)};
  options.grid.cells = draw.integer(1, 40);
  options.grid.grading = draw.chance(0.5) ? 1.0 : draw.uniform(1.0, 1.3);
  options.grid.far_boundary = draw.chance(0.5) ? FarBoundary::kInsulated : FarBoundary::kHalfSpace;
  options.drive = draw.chance(0.5) ? Drive::kLayerShear : Drive::kInterfaceSlip;
  if (strategy == Strategy::kForceDriven) options.drive = Drive::kLayerShear, options.friction_coefficient.reset();
  if (draw.chance(0.4)) {
    options.hard_grid =
        GridOptions{options.grid.thickness * draw.log_uniform(0.02, 5.0), draw.integer(1, 40), draw.uniform(1.0, 1.3),
                    draw.chance(0.5) ? FarBoundary::kInsulated : FarBoundary::kHalfSpace};
  }
  if (options.hard_grid && strategy == Strategy::kVelocityDriven && options.drive == Drive::kLayerShear &&
      draw.chance(0.6)) {
    options.taylor_quinney_factor = draw.chance(0.5) ? 1.0 : draw.uniform(0.5, 1.0);
  }
  if (draw.chance(0.3)) soft.melting_curve = MeltingCurve::kLindemann;
  if (draw.chance(0.3)) soft.pressure_term = PressureTerm::kCompressed;
  if (draw.chance(0.3)) {
    const double C = draw.chance(0.25) ? 0.0 : draw.log_uniform(1e-3, 0.2);
    const double rate = draw.chance(0.5) ? 1.0 : draw.log_uniform(1e-3, 1e8);
    follow_johnson_cook(soft, soft.yield_strength * draw.log_uniform(0.1, 5.0), C, rate, draw.log_uniform(0.4, 2.0),
                        draw.chance(0.5) ? 300.0 : draw.uniform(1.0, 1000.0));
  }
  if (strategy == Strategy::kForceDriven) options.plastic_layer = draw.chance(0.5);
  if (strategy == Strategy::kForceDriven) {
    // Next to a layer that flows the contact is drawn from a copy of the generator, so that the other draws stay as they
    // were before such a layer had contact laws.
    Draw aside = draw;
    if (!options.plastic_layer)
      draw_contact(draw, extreme, options);
    else if (!extreme)
      draw_contact(aside, extreme, options);
  }
  if (strategy == Strategy::kForceDriven && !properties_of(options.interface.friction_law).depends_on_slip() &&
      goes_with(Property::kTemperatureDependentFriction, options) && draw.chance(0.3))
    draw_softening(draw, options);
  if (!only_open_is_second_order(options) && goes_with(Property::kSecondOrder, options) && draw.chance(0.8))
    options.time_integrator = TimeIntegrator::kSdirk2;
  if (goes_with(Property::kModes, options) && draw.chance(0.5)) {
    options.modes = {.accuracy = 1e-4, .shortest_step = extreme ? 1e-12 : 1e-10, .longest_time = extreme ? 1e-3 : 1e-6};
  }
  options.initial_temperature = draw.chance(0.3) ? 1220.0 - draw.log_uniform(1e-6, 100.0) : draw.uniform(1.0, 1200.0);
  // Draws from a copy of the generator, so that scenes without the Preston-Tonks-Wallace law stay as they were before
  // this law was added.
  if (Draw aside = draw; aside.chance(0.2)) {
    adopt_flow_law(soft, random_preston_tonks_wallace(aside));
    options.time_integrator = TimeIntegrator::kBackwardEuler;
  }
  // The same for the contacts that were added later.
  if (Draw aside = draw; aside.chance(0.5)) {
    draw_other_contact(aside, extreme, options);
    if (!goes_with(Property::kSecondOrder, options)) options.time_integrator = TimeIntegrator::kBackwardEuler;
  }
  return options;
}

// Draws options with inertia, combined with options that are valid together with inertia.
inline ModelOptions random_inertia_options(Draw& draw, bool extreme) {
  ModelOptions options;
  do {
    options = random_options(draw, Strategy::kVelocityDriven, extreme);
  } while (!properties_of(options.soft.flow_law).has_wave_return);
  options.drive = Drive::kLayerShear;
  options.taylor_quinney_factor.reset();
  options.interface.friction_law = {};
  options.junctions.reset();
  // Draws from a copy of the generator, so that scenes of backward Euler stay as they were before the waves had SDIRK2.
  Draw aside = draw;
  options.time_integrator = aside.chance(0.5) ? TimeIntegrator::kSdirk2 : TimeIntegrator::kBackwardEuler;
  options.inertia = true;
  options.soft.density *= draw.log_uniform(extreme ? 1e-9 : 0.01, 10.0);
  return options;
}

// The same force-driven, and by any flow law; extreme steps of laws with a rate take long.
inline ModelOptions random_forced_inertia_options(Draw& draw, bool extreme) {
  ModelOptions options;
  do {
    options = random_options(draw, Strategy::kForceDriven, extreme);
    options.inertia = true;
    options.time_integrator = draw.chance(0.5) ? TimeIntegrator::kSdirk2 : TimeIntegrator::kBackwardEuler;
  } while (!refusals(options).empty() || (extreme && !properties_of(options.soft.flow_law).has_wave_return));
  options.soft.density *= draw.log_uniform(extreme ? 1e-9 : 0.01, 10.0);
  return options;
}

// The velocity-driven ones with any contact law, with junctions or with both.
inline ModelOptions random_inertia_contact_options(Draw& draw, bool extreme) {
  ModelOptions options = random_inertia_options(draw, extreme);
  if (!options.friction_coefficient) options.friction_coefficient = draw.log_uniform(0.01, 1.0);
  draw_other_contact(draw, extreme, options);
  if (options.junctions && draw.chance(0.3)) {
    options.friction_coefficient.reset();
    options.interface.friction_law = {};
  }
  return options;
}

// The same with plastic work that heats in place, under any contact law or none.
inline ModelOptions random_inertia_heat_options(Draw& draw, bool extreme) {
  ModelOptions options =
      draw.chance(0.5) ? random_inertia_contact_options(draw, extreme) : random_inertia_options(draw, extreme);
  if (!options.hard_grid) options = two_sided(options);
  options.taylor_quinney_factor = draw.chance(0.5) ? 1.0 : draw.uniform(0.1, 1.0);
  return options;
}

// The force-driven ones with inertia whose plastic work heats in place, under any contact law.
inline ModelOptions random_forced_inertia_heat_options(Draw& draw, bool extreme) {
  ModelOptions options = random_forced_inertia_options(draw, extreme);
  if (!options.hard_grid) options = two_sided(options);
  options.taylor_quinney_factor = draw.chance(0.5) ? 1.0 : draw.uniform(0.1, 1.0);
  return options;
}

// Lets plastic work heat a force-driven layer, with a fair chance where options allow it.
inline void draw_work_heat(Draw& draw, ModelOptions& options) {
  if (options.strategy == Strategy::kForceDriven && options.plastic_layer && options.hard_grid && draw.chance(0.6))
    options.taylor_quinney_factor = draw.chance(0.5) ? 1.0 : draw.uniform(0.1, 1.0);
}

// Draws options with two tangential components, combined with options that are valid together with them.
inline ModelOptions random_two_component_options(Draw& draw, Strategy strategy, bool extreme) {
  ModelOptions options = random_options(draw, strategy, extreme);
  options.drive = Drive::kLayerShear;
  options.tangential_components = 2;
  return options;
}

// Draws options with a melt film, combined with options that are valid together with it.
inline ModelOptions random_melting_options(Draw& draw, bool extreme) {
  ModelOptions options;
  do {
    options = random_options(draw, Strategy::kForceDriven, extreme);
    options.plastic_layer = false;
    options.junctions.reset();
    options.modes.reset();
    options.time_integrator = TimeIntegrator::kBackwardEuler;
    options.melt_film =
        MeltFilmOptions{.latent_heat = draw.log_uniform(extreme ? 1.0 : 1e4, extreme ? 1e8 : 1e6),
                        .viscosity = draw.log_uniform(extreme ? 1e-9 : 1e-4, extreme ? 1e6 : 1.0),
                        .activation_energy = draw.chance(0.5) ? 0.0 : draw.uniform(0.0, extreme ? 1e6 : 1e5)};
    if (!options.hard_grid) options = two_sided(options);
    if (draw.chance(0.2)) options.grid.far_boundary = options.hard_grid->far_boundary = FarBoundary::kIsothermal;
    if (draw.chance(0.2)) options.tangential_components = extreme ? 1 : 2;
  } while (!refusals(options).empty());
  return options;
}

// The solver for which random_options() draws the options of a model.
enum class Solver {
  kVelocityDriven,
  kForceDriven,
  kInertia,
  kInertiaHeat,
  kMeltFilm,
  kForcedInertia,
  kForcedInertiaHeat
};

inline ModelOptions random_options(Draw& draw, Solver solver, bool extreme) {
  if (solver == Solver::kInertia)
    return draw.chance(0.5) ? random_inertia_contact_options(draw, extreme) : random_inertia_options(draw, extreme);
  if (solver == Solver::kForcedInertia) return random_forced_inertia_options(draw, extreme);
  if (solver == Solver::kInertiaHeat) return random_inertia_heat_options(draw, extreme);
  if (solver == Solver::kForcedInertiaHeat) return random_forced_inertia_heat_options(draw, extreme);
  if (solver == Solver::kMeltFilm) {
    ModelOptions options = random_melting_options(draw, extreme);
    options.tangential_components = 1;
    return options;
  }
  return random_options(draw, solver == Solver::kForceDriven ? Strategy::kForceDriven : Strategy::kVelocityDriven,
                        extreme);
}

inline std::string name_of(Solver solver) {
  if (solver == Solver::kMeltFilm) return "MeltFilm";
  if (solver == Solver::kForcedInertia) return "ForcedInertia";
  if (solver == Solver::kForcedInertiaHeat) return "ForcedInertiaHeat";
  if (solver == Solver::kInertiaHeat) return "InertiaHeat";
  return solver == Solver::kInertia ? "Inertia" : solver == Solver::kForceDriven ? "ForceDriven" : "VelocityDriven";
}

// With probability 1/2 makes a conducting hard body colder or hotter than the layer, so that the interface need not be
// the hottest place.
inline void start_hard_elsewhere(Draw& draw, Rig& rig) {
  if (!rig.model.options().hard_grid || draw.chance(0.5)) return;
  const double layer = rig.model.options().initial_temperature;
  const double hottest = rig.model.options().soft.melting_temperature;
  rig.start_hard(draw.chance(0.7) ? draw.uniform(0.1, 1.0) * layer : draw.uniform(layer, hottest));
}

inline double random_dt(Draw& draw, bool extreme) {
  return extreme ? draw.log_uniform(1e-12, 1e-5) : draw.log_uniform(1e-10, 1e-8);
}

// The mass of a layer with inertia, which a force-driven host's soft half zone has and a little more, and the little that
// its hard half zone has  [kg/m2]; else 0.
struct MassOfWaves {
  double soft, hard;
};
inline MassOfWaves mass_of_waves(const ModelOptions& options) {
  if (!options.inertia || options.strategy != Strategy::kForceDriven) return {0.0, 0.0};
  const double layer = options.soft.density * options.grid.thickness, little = 1e-3 * layer + 1e-5;
  return {layer + little, little};
}

// Draws the inputs of all lanes for one step. Pressure, velocity jump and masses mostly keep their last values; rates
// and stresses are drawn anew.
inline void random_inputs(Draw& draw, Rig& rig, bool extreme) {
  for (int l = 0; l < kLanes; ++l) {
    TileInputs& in = rig.inputs;
    if (draw.chance(0.3)) {
      const double kind = draw.uniform(0.0, 1.0);
      in.pressure[l] = kind < 0.05   ? 0.0
                       : kind < 0.35 ? draw.log_uniform(1e3, 1e9)
                                     : draw.uniform(extreme ? -20e9 : -1e9, extreme ? 200e9 : 30e9);
    }
    if (draw.chance(0.3)) {
      const double magnitude = draw.chance(0.1) ? 0.0 : draw.log_uniform(extreme ? 1e-310 : 1e-3, extreme ? 1e4 : 1e3);
      in.velocity_jump[l] = draw.sign() * magnitude;
    }
    in.soft_shear_rate[l] = draw.chance(0.5) ? 0.0 : draw.sign() * draw.log_uniform(1.0, extreme ? 1e10 : 1e6);
    if (draw.chance(0.3)) {
      in.mass_soft[l] = draw.log_uniform(extreme ? 1e-30 : 1e-3, extreme ? 1e30 : 1.0);
      in.mass_hard[l] = draw.log_uniform(extreme ? 1e-30 : 1e-3, extreme ? 1e30 : 1.0);
      in.mass_soft[l] += mass_of_waves(rig.model.options()).soft;
      in.mass_hard[l] += mass_of_waves(rig.model.options()).hard;
    }
    if (rig.model.options().plastic_layer) {
      const double rate = draw.chance(0.5) ? 0.0 : draw.log_uniform(1.0, extreme ? 1e10 : 1e6);
      const bool odd = (std::bit_cast<std::uint64_t>(rate) & 1U) != 0;  // a sign that no other draw depends on
      in.soft_plastic_strain_rate[l] = odd ? -rate : rate;
    }
    in.stress_soft[l] = draw.chance(0.1) ? 0.0 : draw.sign() * draw.log_uniform(1e3, extreme ? 1e12 : 1e9);
    in.stress_hard[l] = draw.chance(0.1) ? 0.0 : draw.sign() * draw.log_uniform(1e3, extreme ? 1e12 : 1e9);
  }
}

// Draws inputs for a model with two tangential components: first inputs along the first component, then an angle for
// each vector (velocity jump, far stresses, plastic shear), by which it is turned.
inline void random_vectors(Draw& draw, Rig& rig, bool extreme) {
  random_inputs(draw, rig, extreme);
  const auto turn = [&](double& first, double& second) {
    const double angle = draw.chance(0.5) ? draw.uniform(-0.1, 0.1) : draw.uniform(-M_PI, M_PI);
    const double length = first;
    first = length * std::cos(angle);
    second = length * std::sin(angle);
  };
  for (int l = 0; l < kLanes; ++l) {
    turn(rig.inputs.velocity_jump[l], rig.inputs.second_velocity_jump[l]);
    turn(rig.inputs.stress_soft[l], rig.inputs.second_stress_soft[l]);
    turn(rig.inputs.stress_hard[l], rig.inputs.second_stress_hard[l]);
    turn(rig.inputs.soft_plastic_strain_rate[l], rig.inputs.second_soft_plastic_strain_rate[l]);
  }
}

}  // namespace shearbus::testing
