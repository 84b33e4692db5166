// server/physics/MODEL.md, "What always holds", over random scenes, states and inputs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

constexpr int kScenes = 120;
constexpr int kSteps = 25;
constexpr double kTiny = 1e-290;  // products of denormal inputs have no relative accuracy

// Laws that temperature softens are held to between the limits of a temperature a few last digits colder and hotter:
// near melting that is all there is to hold to.
struct Limits {
  double lower, upper;
};

int first_vertex(const Rig& rig) {
  return -static_cast<int>(rig.model.layout().num_hard_vertices);
}
int num_vertices(const Rig& rig) {
  return static_cast<int>(rig.model.layout().num_vertices);
}

struct Before {
  Before(const Rig& rig, int lane) : s(rig.stress(lane)) {
    if (const TileLayout& layout = rig.model.layout(); layout.heat_modes != TileLayout::kAbsent) {
      coldest = rig.committed[layout.heat_modes + static_cast<std::size_t>(lane)];
      kept = rig.committed[layout.heat_modes + kLanes + static_cast<std::size_t>(lane)];
    } else {
      heat = rig.stored_heat(0.0, lane);
    }
    for (int i = first_vertex(rig); i < num_vertices(rig); ++i) {
      coldest = std::min(coldest, rig.T(i, lane));
      hottest = std::max(hottest, rig.T(i, lane));
    }
    if (rig.model.layout().plastic_strain == TileLayout::kAbsent) return;
    slip = rig.plastic_slip(lane);
    for (int i = 0; i < rig.model.grid().num_vertices(); ++i) ep.push_back(rig.ep(i, lane));
  }
  double heat = 0.0, kept = 0.0, s, slip = 0.0, coldest = 1e300, hottest = 0.0;
  std::vector<double> ep;
};

// 1, 3, 5: temperatures in their range and falling from the interface where nothing else takes heat from it, heat and
// work balanced, no energy from friction.
void expect_sound(const Rig& rig, const Before& before, int lane, double dt) {
  const ModelOptions& options = rig.model.options();
  const TileOutputs& out = rig.outputs;
  ASSERT_FALSE(out.outcome[lane] & kFailed);
  ASSERT_TRUE(std::isfinite(out.shear_stress[lane]) && std::isfinite(out.sliding_velocity[lane]) &&
              std::isfinite(out.velocity_jump_new[lane]) && std::isfinite(out.friction_heat[lane]));
  ASSERT_EQ(out.interface_temperature[lane], rig.T(0, lane));
  const bool falls_inwards = !options.hard_grid && options.time_integrator == TimeIntegrator::kBackwardEuler;
  const double T_melt = at_pressure(options.soft, rig.inputs.pressure[lane]).melting_temperature;
  for (int i = first_vertex(rig); i < num_vertices(rig); ++i) {
    const double T = rig.T(i, lane);
    ASSERT_GE(T, before.coldest) << i;
    if (i < 0) {  // the hard body melts elsewhere; but nowhere is hotter than it was somewhere, or than the interface
      const bool divided = (out.outcome[lane] & kSubstepped) != 0;
      const double interface = divided ? T_melt : rig.T(0, lane);
      ASSERT_LE(T, std::max(before.hottest, interface) * (1 + 1e-14)) << i;
    } else if (options.soft.melting_curve == MeltingCurve::kConstant) {
      ASSERT_LT(T, options.soft.melting_temperature);
    } else {  // pressure may have been higher before
      ASSERT_LE(T, std::max(T_melt, before.hottest * (1 + 1e-15)));
    }
    if (i > 0 && falls_inwards) {
      ASSERT_LE(T, rig.T(i - 1, lane) * (1 + 1e-15));
    }
  }
  ASSERT_GE(out.shear_stress[lane] * out.sliding_velocity[lane], 0.0);
  ASSERT_GE(out.friction_heat[lane], 0.0);
  if (!options.modes) {
    ASSERT_NEAR(rig.stored_heat(0.0, lane) - before.heat, out.friction_heat[lane], 1e-12 * before.heat);
  } else if (const HeatKernel kernel(options.soft, options.grid);
             !kernel.far_face_unfelt(options.modes->longest_time)) {
    // The first mode of a slab is the mean temperature.
    const double kept = rig.committed[rig.model.layout().heat_modes + kLanes + static_cast<std::size_t>(lane)];
    const double capacity = options.soft.conductivity / options.soft.diffusivity * options.grid.thickness;
    ASSERT_NEAR(capacity * (kept - before.kept), out.friction_heat[lane], 1e-12 * capacity * (kept + 1.0));
  }

  const double beta_T = rig.conducted_share();
  const double s = out.shear_stress[lane];
  const bool second_order = options.time_integrator == TimeIntegrator::kSdirk2 && !(out.outcome[lane] & kFirstOrder);
  if (options.strategy == Strategy::kVelocityDriven && second_order) {
    return;  // heat is that of the stress at both stages; the work at the end of the step is not the whole
  } else if (options.strategy == Strategy::kVelocityDriven) {
    const double work = std::max(0.0, s * rig.inputs.velocity_jump[lane]) * dt;
    const double factor = options.taylor_quinney_factor.value_or(1.0);
    ASSERT_GE(out.friction_heat[lane], factor * beta_T * work * (1 - 1e-13) - kTiny);
    ASSERT_LE(out.friction_heat[lane], beta_T * work * (1 + 1e-13) + kTiny);
  } else if (!(out.outcome[lane] & kSubstepped)) {
    const double work = s * out.sliding_velocity[lane] * dt;
    ASSERT_NEAR(out.friction_heat[lane], beta_T * work, 1e-13 * work + kTiny);
  }
}

// 2: the layer never carries more than its flow stress, and exactly that where it flowed.
void expect_complementary_flow(const Rig& rig, const Before& before, int lane, double dt) {
  const Material& soft = rig.model.options().soft;
  const double a = std::abs(rig.stress(lane));
  const double P = rig.inputs.pressure[lane];
  for (int i = 0; i < rig.model.grid().num_vertices(); ++i) {
    const double ep = rig.ep(i, lane);
    ASSERT_GE(ep, before.ep[i]);
    if (P <= 0.0) continue;
    // The rate of the step, as well as a difference of strains tells it.
    const double dep = ep - before.ep[i], noise = 4e-16 * ep;
    const auto limit = [&](double T, double increment) { return flow_stress(soft, ep, P, T, increment / dt) / kSqrt3; };
    const double T = rig.T(i, lane);
    ASSERT_LE(a, limit(T * (1 - kDigits), dep + noise) * (1 + 1e-10)) << "vertex " << i;
    if (ep > before.ep[i] * (1 + 1e-12) + 1e-15) {
      // Strain resolves to an ulp of itself; a smaller step of it moved the limit by less than it can show.
      ASSERT_GE(a, limit(T * (1 + kDigits), dep - noise) * (1 - 1e-10))
          << "vertex " << i << " T " << T << " ep " << ep << " from " << before.ep[i];
    }
  }
}

// sqrt(3) integral(dep) = w dt - h ds/G0 where the layer carries all the slip.
void expect_slip_balance(const Rig& rig, const Before& before, int lane, double dt) {
  const ModelOptions& options = rig.model.options();
  if (options.drive != Drive::kLayerShear || rig.inputs.pressure[lane] <= 0.0) return;
  if (rig.outputs.regime[lane] == Regime::kCoulomb) return;
  const double h = options.grid.thickness;
  const double wanted =
      std::abs(rig.inputs.velocity_jump[lane]) * dt + h * std::abs(before.s) / options.soft.shear_modulus;
  const double elastic = h * (rig.stress(lane) - before.s) / options.soft.shear_modulus;
  const double direction = rig.stress(lane) != 0.0 ? std::copysign(1.0, rig.stress(lane))
                                                   : std::copysign(1.0, rig.outputs.sliding_velocity[lane]);
  const double plastic = direction * (rig.plastic_slip(lane) - before.slip);
  // Strains are told to their last digits; flow as closely as stress and temperatures are.
  const double resolution = 1e-15 * rig.plastic_slip(lane) + kSqrt3 * flow_grain(rig, before.ep, lane, dt);
  ASSERT_NEAR(plastic + elastic, rig.inputs.velocity_jump[lane] * dt, 1e-9 * wanted + resolution + kTiny)
      << "T0 " << rig.T(0, lane) << " s " << rig.stress(lane);
  ASSERT_NEAR(rig.outputs.sliding_velocity[lane] * dt, plastic, 1e-9 * wanted + resolution + kTiny);
}

// What the interface can carry, whatever holds it.
Limits interface_limits(const Rig& rig, int lane, double size, double dt) {
  const ModelOptions& options = rig.model.options();
  const InterfaceOptions& law = options.interface;
  const double P = rig.inputs.pressure[lane];
  // Junctions have hardened with the slip, which is known as well as the jumps it is a difference of.
  Limits strength{law.yield_strength, law.yield_strength};
  if (options.junctions) {
    const auto& [fraction, height, metal] = *options.junctions;
    const double grown = kDigits * size * dt / (kSqrt3 * height);
    const double strain = rig.junction_strain(lane);
    strength = {fraction * hardened_strength(metal, std::max(0.0, strain - grown)),
                fraction * hardened_strength(metal, strain + grown)};
  }
  double mu = law.friction_coefficient;
  if (law.friction_law != FrictionLaw{}) {
    mu = VelocityWeakening{mu, law.friction_coefficient_fast, law.velocity_decay}.coefficient(
        std::abs(rig.outputs.sliding_velocity[lane]));
  }
  const double T0 = rig.outputs.interface_temperature[lane];
  const auto limit = [&](double yield, double T) {
    return std::min(mu * P, yield * softening(options.soft, P, T).g / kSqrt3);
  };
  return {limit(strength.lower, T0 * (1 + kDigits)) * (1 - 1e-10),
          limit(strength.upper, T0 * (1 - kDigits)) * (1 + 1e-10)};
}

// Bodies of almost no mass reach jumps of which the last digit, as heat, melts the interface, or stresses that are less
// than what the last digit of T0 makes of its strength: nothing is resolved there.
bool is_resolved(const Rig& rig, int lane, double size, double dt) {
  constexpr double kGrain = 1e-9;  // [K]
  constexpr double kShare = 1e-3;  // of the stress
  const Material& soft = rig.model.options().soft;
  const double s = std::abs(rig.stress(lane));
  const double flux = std::numeric_limits<double>::epsilon() * size * s;
  const Limits limit = interface_limits(rig, lane, size, dt);
  return flux * std::sqrt(soft.diffusivity * dt) / soft.conductivity <= kGrain &&
         limit.upper - limit.lower <= kShare * s;
}

// A flowing layer: DLP (64) at the middle of the step where the interface slips, at its end where it sticks. `held`
// counts those that could be held to that, `all` those that carry a stress.
void expect_flowing_slip(const Rig& rig, const Before& before, int lane, double dt, int& held, int& all) {
  const ModelOptions& options = rig.model.options();
  const TileOutputs& out = rig.outputs;
  if (rig.inputs.pressure[lane] <= 0.0 || (out.outcome[lane] & kSubstepped)) return;
  const double s = out.shear_stress[lane];
  if (s == 0.0) return;  // no direction
  const double d = std::copysign(1.0, s);
  const double drive = kSqrt3 * options.grid.thickness * rig.inputs.soft_plastic_rate[lane];
  const double jump_old = d * rig.inputs.velocity_jump[lane];
  const double jump_new = d * out.velocity_jump_new[lane];
  const double flow = (rig.plastic_slip(lane) - before.slip) / dt;
  const double size = std::abs(jump_old) + std::abs(jump_new) + drive + flow +
                      dt * (std::abs(rig.inputs.stress_minus[lane]) / rig.inputs.mass_minus[lane] +
                            std::abs(rig.inputs.stress_plus[lane]) / rig.inputs.mass_plus[lane]);
  ++all;
  if (!is_resolved(rig, lane, size, dt)) return;
  ++held;
  expect_complementary_flow(rig, before, lane, dt);
  double tolerance =
      1e-9 * size + 1e-14 * rig.plastic_slip(lane) / dt + kSqrt3 * flow_grain(rig, before.ep, lane, dt) / dt;
  const bool sticks = rig.committed[rig.model.layout().sticking + lane] != 0.0;
  if (sticks) {
    ASSERT_NEAR(jump_new + drive, flow, tolerance);
    ASSERT_NEAR(d * out.sliding_velocity[lane], std::max(0.0, 0.5 * (jump_old - jump_new)), 1e-9 * size);
  } else {
    // The heat of the slip makes T0, T0 the stress, the stress the slip: in (61), and by the heat again.
    const Limits limit = interface_limits(rig, lane, size, dt);
    const double per_stress = dt * (1 / rig.inputs.mass_minus[lane] + 1 / rig.inputs.mass_plus[lane]);
    tolerance += (limit.upper - limit.lower) * (per_stress + std::abs(out.sliding_velocity[lane] / s));
    ASSERT_NEAR(d * out.sliding_velocity[lane], std::max(0.0, 0.5 * (jump_old + jump_new) + drive - flow), tolerance);
    ASSERT_GE(jump_new + drive - flow, -tolerance);  // friction never pulls past rest
  }
}

void expect_interface_law(const Rig& rig, int lane, double dt, double jump_old) {
  const ModelOptions& options = rig.model.options();
  const TileInputs& in = rig.inputs;
  const TileOutputs& out = rig.outputs;
  const double s = out.shear_stress[lane];
  // DLP (61).
  const double driven = dt * (in.stress_minus[lane] / in.mass_minus[lane] + in.stress_plus[lane] / in.mass_plus[lane]);
  const double taken = s * (dt * (1 / in.mass_minus[lane] + 1 / in.mass_plus[lane]));
  const double size = std::abs(jump_old) +
                      dt * (std::abs(in.stress_minus[lane]) / in.mass_minus[lane] +
                            std::abs(in.stress_plus[lane]) / in.mass_plus[lane]) +
                      std::abs(taken);
  ASSERT_NEAR(out.velocity_jump_new[lane], jump_old + driven - taken, 1e-13 * size + kTiny);
  if (out.outcome[lane] & kSubstepped) return;  // the mean of several answers
  if (in.pressure[lane] <= 0.0) {
    ASSERT_EQ(s, 0.0);
    return;
  }
  if (options.plastic_layer && !is_resolved(rig, lane, size, dt)) return;
  const Limits limit = interface_limits(rig, lane, size, dt);
  const double T0 = out.interface_temperature[lane];
  // Of a second-order step s is the mean, and the limit moved: then only sense and stick are held here, the stresses
  // of the stages by the scalar twin.
  const bool mean = options.time_integrator == TimeIntegrator::kSdirk2 && out.outcome[lane] == 0 &&
                    out.regime[lane] != Regime::kStick;
  if (!mean) {
    ASSERT_LE(std::abs(s), limit.upper) << "T0 " << T0;
  } else {
    ASSERT_LE(std::abs(s), options.interface.friction_coefficient * in.pressure[lane] * (1 + 1e-12));
  }
  if (options.plastic_layer && rig.committed[rig.model.layout().sticking + lane] != 0.0) return;
  if (out.regime[lane] == Regime::kStick) {
    ASSERT_EQ(out.velocity_jump_new[lane], 0.0);
  } else {
    if (!mean) {
      ASSERT_GE(std::abs(s), limit.lower) << "T0 " << T0;
    }
    if (options.plastic_layer) return;
    ASSERT_GE(s * out.velocity_jump_new[lane], -1e-12 * std::abs(s) * size);  // friction never pulls past rest
  }
}

struct Case {
  Strategy strategy;
  bool extreme;
};
void PrintTo(const Case& c, std::ostream* os) {
  *os << (c.strategy == Strategy::kVelocityDriven ? "VelocityDriven" : "ForceDriven") << (c.extreme ? "Extreme" : "");
}

class PhysicsInvariants : public ::testing::TestWithParam<Case> {};

TEST_P(PhysicsInvariants, HoldForRandomScenesAndInputs) {
  const auto [strategy, extreme] = GetParam();
  Draw draw(2024 + (extreme ? 1 : 0));
  int flowing = 0, melting = 0, sticking = 0, coulomb = 0, divided = 0, held = 0, carrying = 0;
  for (int scene = 0; scene < kScenes; ++scene) {
    Rig rig(random_options(draw, strategy, extreme));
    start_hard_elsewhere(draw, rig);
    const bool closed_loop = draw.chance(0.5);
    for (int step = 0; step < kSteps; ++step) {
      random_inputs(draw, rig, extreme);
      if (closed_loop && step > 0 && strategy == Strategy::kForceDriven) {
        std::copy_n(rig.outputs.velocity_jump_new, kLanes, rig.inputs.velocity_jump);
      }
      const double dt = random_dt(draw, extreme);
      std::vector<Before> before;
      for (int l = 0; l < kLanes; ++l) before.emplace_back(rig, l);
      rig.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(step) + ", lane " +
                     std::to_string(l));
        expect_sound(rig, before[l], l, dt);
        if (strategy == Strategy::kVelocityDriven) {
          expect_complementary_flow(rig, before[l], l, dt);
          expect_slip_balance(rig, before[l], l, dt);
        } else {
          expect_interface_law(rig, l, dt, rig.inputs.velocity_jump[l]);
          if (rig.model.options().plastic_layer) expect_flowing_slip(rig, before[l], l, dt, held, carrying);
        }
        if (::testing::Test::HasFatalFailure()) return;
        flowing += rig.outputs.regime[l] == Regime::kTresca;
        melting += rig.outputs.regime[l] == Regime::kMelting;
        sticking += rig.outputs.regime[l] == Regime::kStick;
        coulomb += rig.outputs.regime[l] == Regime::kCoulomb;
        divided += (rig.outputs.outcome[l] & kSubstepped) != 0;
      }
    }
  }
  std::printf("%d node-steps: stick %d, coulomb %d, tresca %d, melting %d, divided %d; %d of %d layers held to (64)\n",
              kScenes * kSteps * kLanes, sticking, coulomb, flowing, melting, divided, held, carrying);
  EXPECT_GE(held, 0.6 * carrying);
  // The draws reach every regime: an invariant of a regime never visited would be no test.
  EXPECT_GT(std::min({flowing, melting, sticking, coulomb}), 100);
}

INSTANTIATE_TEST_SUITE_P(, PhysicsInvariants,
                         ::testing::Values(Case{Strategy::kVelocityDriven, false},
                                           Case{Strategy::kVelocityDriven, true}, Case{Strategy::kForceDriven, false},
                                           Case{Strategy::kForceDriven, true}),
                         [](const auto& test) { return ::testing::PrintToString(test.param); });

}  // namespace
}  // namespace shearbus::testing
