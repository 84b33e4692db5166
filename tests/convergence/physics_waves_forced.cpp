// Layers with inertia between the masses of a force-driven host: exact solutions of an elastic layer between two bodies
// that give way, order in time, and the limit of a layer without mass.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>
#include <utility>

#include "server/physics/material/strength.hpp"
#include "server/physics/solver/parts.hpp"
#include "tests/support/waves.hpp"

namespace shearbus::testing {
namespace {

constexpr double kPressure = 5e8;     // compression of the contact  [Pa]
constexpr double kPush = 6e8;         // the largest far stress  [Pa]
constexpr double kMassBehind = 0.05;  // of the soft half zone behind the layer, whose own is 0.056  [kg/m2]
constexpr double kMassHard = 0.03;    // [kg/m2]

// An elastic layer at one temperature on a contact that carries as much as `limit`  [Pa].
ModelOptions elastic_layer(double limit) {
  ModelOptions options = with_inertia(paper_options(Strategy::kForceDriven));
  options.plastic_layer = true;
  options.soft.temperature_coefficient = options.soft.pressure_coefficient = 0.0;
  options.soft.melting_temperature = 1e12;
  options.soft.yield_strength = 1e11;
  options.soft.yield_strength_max = std::numeric_limits<double>::infinity();
  options.interface = {.friction_coefficient = limit / kPressure, .yield_strength = 1e12};
  return options;
}

double push_at(double t) {
  return kPush * std::pow(std::sin(M_PI * t / 40e-9), 4);
}

// Exact solution until the wave that both faces have returned comes to z = 0, after three crossings: the mass behind the
// layer moves by M V' = push - Z V, its wave arrives after a crossing and meets the hard body, of which
// m V_h' = s, s = Z (2 V - v - V_h) with the slip v that leaves s at its limit.
struct Exact {
  double stress, slip;
};
Exact exact_at(const ModelOptions& options, double limit, double t) {
  const double Z = impedance(options.soft), cross = options.grid.thickness / shear_speed(options.soft);
  struct State {
    double V = 0.0, hard = 0.0;
  } y;
  const auto stress = [&](const State& at) { return std::min(limit, Z * (2.0 * at.V - at.hard)); };
  const auto rate = [&](double tau, const State& at) {
    return State{(push_at(tau) - Z * at.V) / kMassBehind, stress(at) / kMassHard};
  };
  const auto moved = [](const State& at, double dt, const State& by) {
    return State{at.V + dt * by.V, at.hard + dt * by.hard};
  };
  constexpr int kSteps = 2000;
  const double dt = std::max(0.0, t - cross) / kSteps;
  for (int n = 0; n < kSteps; ++n) {
    const double tau = n * dt;
    const State k1 = rate(tau, y), k2 = rate(tau + 0.5 * dt, moved(y, 0.5 * dt, k1)),
                k3 = rate(tau + 0.5 * dt, moved(y, 0.5 * dt, k2)), k4 = rate(tau + dt, moved(y, dt, k3));
    y = moved(y, dt / 6.0, {k1.V + 2.0 * k2.V + 2.0 * k3.V + k4.V, k1.hard + 2.0 * k2.hard + 2.0 * k3.hard + k4.hard});
  }
  const double s = stress(y);
  return {s, 2.0 * y.V - s / Z - y.hard};
}

// Sets the far stresses of a step and the jump that the last one has left.
void go_on(Rig& rig, double push, bool first) {
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.stress_soft[l] = push;
    rig.inputs.stress_hard[l] = 0.0;
    rig.inputs.mass_soft[l] = kMassBehind + rig.model.options().soft.density * rig.model.options().grid.thickness;
    rig.inputs.mass_hard[l] = kMassHard;
    if (!first) rig.inputs.velocity_jump[l] = rig.outputs.velocity_jump_new[l];
  }
}

struct Errors {
  double stress, slip;  // root mean square, relative to the largest exact values
};
Errors errors_of(const ModelOptions& options, double limit, int steps) {
  const double cross = options.grid.thickness / shear_speed(options.soft), end = 2.9 * cross, dt = end / steps;
  Rig rig(options, 1);
  rig.set_all(0.0, kPressure);
  double stress = 0.0, slip = 0.0, most_stress = 0.0, most_slip = 1e-3;
  for (int n = 0; n < steps; ++n) {
    go_on(rig, push_at((n + 0.5) * dt), n == 0);
    rig.step(dt);
    const Exact exact = exact_at(options, limit, (n + 1) * dt);
    // Of two stages [v] is the mean of the step.
    const bool mean = options.time_integrator == TimeIntegrator::kSdirk2;
    const double slides = mean ? exact_at(options, limit, (n + 0.5) * dt).slip : exact.slip;
    stress += std::pow(stress_at(rig, 0) - exact.stress, 2);
    slip += std::pow(rig.outputs.sliding_velocity[0] - slides, 2);
    most_stress = std::max(most_stress, exact.stress);
    most_slip = std::max(most_slip, exact.slip);
  }
  return {std::sqrt(stress / steps) / most_stress, std::sqrt(slip / steps) / most_slip};
}

TEST(PhysicsWavesForced, AnElasticLayerBetweenTwoMassesFollowsTheExactSolution) {
  constexpr double kStrong = 1e12, kWeak = 3e7;
  std::printf("elastic layer between two masses, 18 ns: limit, integrator, steps, error of s(0), of [v], order\n");
  for (const double limit : {kStrong, kWeak})
    for (const TimeIntegrator integrator : {TimeIntegrator::kBackwardEuler, TimeIntegrator::kSdirk2}) {
      const bool second = integrator == TimeIntegrator::kSdirk2, slips = limit == kWeak;
      double coarsest = 0.0;
      for (const int refined : {1, 2, 4, 8}) {
        ModelOptions options = elastic_layer(limit);
        options.time_integrator = integrator;
        options.grid.cells = 40 * refined;
        ASSERT_TRUE(refusals(options).empty());
        const Errors error = errors_of(options, limit, 45 * refined);
        const double shown = slips ? error.slip : error.stress;
        const double order = refined > 1 ? std::log2(coarsest / shown) / std::log2(refined) : NAN;
        std::printf("  %8.1g Pa  %s  %4d  %9.2e  %9.2e  %5.2f\n", limit, second ? "sdirk2" : "Euler ", 45 * refined,
                    error.stress, error.slip, order);
        if (refined == 1) coarsest = shown;
        if (refined < 8) continue;
        EXPECT_GT(order, !second ? 0.9 : slips ? 1.4 : 1.9) << limit;  // where slip starts the step is of first order
        EXPECT_LT(shown, second ? 2e-3 : 2e-2) << limit;
      }
    }
}

// A contact that closes later: the layer flies with the soft body, without stress, and meets the hard body as one. Until its
// wave comes back from z = h the hard body follows m V' = s, s = Z (V0 - V).
TEST(PhysicsWavesForced, ALayerThatFliesMeetsTheHardBodyAtTheSpeedOfItsHost) {
  ModelOptions options = elastic_layer(1e12);
  options.grid.cells = 400;
  Rig rig(options, 1);
  constexpr double kFarStress = 1e9, kMassSoft = 0.08, kDt = 0.025e-9, kFront = 0.25e-9;
  constexpr int kFlies = 40, kMeets = 200;
  const double Z = impedance(options.soft);
  double jump = 15.0, worst = 0.0;
  for (int n = 0; n < kFlies + kMeets; ++n) {
    const bool flies = n < kFlies;
    rig.set_all(jump, flies ? -1.0 : kPressure);
    for (int l = 0; l < kLanes; ++l) {
      rig.inputs.mass_soft[l] = kMassSoft;
      rig.inputs.mass_hard[l] = kMassHard;
      rig.inputs.stress_soft[l] = flies ? kFarStress : 0.0;
    }
    rig.step(kDt);
    jump = rig.outputs.velocity_jump_new[0];
    const double met = 15.0 + kFlies * kDt * kFarStress / kMassSoft, t = (n + 1 - kFlies) * kDt;
    if (flies) {
      ASSERT_EQ(rig.outputs.regime[0], Regime::kOpen);
      ASSERT_EQ(rig.outputs.shear_stress[0], 0.0);
      for (int c = 0; c <= rig.model.grid().num_cells(); ++c) ASSERT_EQ(velocity_in(rig, c), jump);
      if (n + 1 == kFlies) {
        ASSERT_NEAR(jump, met, 1e-12 * met);
      }
    } else if (t > kFront) {
      worst = std::max(worst, std::abs(stress_at(rig, 0) / (Z * met) - std::exp(-Z * t / kMassHard)));
    }
  }
  std::printf("a layer that meets the hard body at 15.5 m/s: s(0) to %.1e of Z V0 in 5 ns\n", worst);
  EXPECT_LT(worst, 3e-3);
}

// A layer with waves that weighs and stores next to nothing, and the one without inertia: both slow down from 100 m/s
// under a far stress, each with the jumps of its own answers.
struct MasslessPair {
  MasslessPair(double interface_strength, std::optional<double> taylor_quinney_factor)
      : options(options_of(interface_strength, taylor_quinney_factor)),
        rigid(options, 1),
        waves(with_inertia(options), 1) {
    for (Rig* rig : {&rigid, &waves}) {
      rig->set_all(100.0, kCompression);
      rig->inputs.stress_soft[0] = 1e8;
      rig->inputs.mass_soft[0] = 0.5;
      rig->inputs.mass_hard[0] = 2.0;
    }
  }
  void step(double dt) {
    for (Rig* rig : {&rigid, &waves}) {
      rig->step(dt);
      rig->inputs.velocity_jump[0] = rig->outputs.velocity_jump_new[0];
    }
  }
  double jumps_apart() const {
    return std::abs(rigid.outputs.velocity_jump_new[0] - waves.outputs.velocity_jump_new[0]) / 100.0;
  }
  double temperatures_apart() const { return std::abs(rigid.T(0) - waves.T(0)) / 900.0; }
  bool slips() const { return waves.outputs.sliding_velocity[0] > 1.0; }

  static constexpr double kCompression = 11.2e9;  // [Pa]
  static constexpr double kTime = 100e-9;
  ModelOptions options;
  Rig rigid, waves;

 private:
  static ModelOptions options_of(double interface_strength, std::optional<double> taylor_quinney_factor) {
    ModelOptions options = two_sided(graded(paper_options(Strategy::kForceDriven)));
    options.plastic_layer = true;
    options.soft.hardening_coefficient = 125.0;
    options.soft.shear_modulus *= 1e5;
    options.soft.density *= 1e-7;
    options.interface = {.friction_coefficient = 1.0, .yield_strength = interface_strength};
    options.taylor_quinney_factor = taylor_quinney_factor;
    return options;
  }
};

// Without mass and elasticity the layer is that of the force-driven step without inertia, which takes the mean slip of a
// step where the waves take that of its end: the difference falls with dt. So does that of work that heats in place.
TEST(PhysicsWavesForced, ALayerWithoutMassIsTheOneWithoutInertia) {
  struct Case {
    const char* name;
    double interface_strength;  // [Pa]
    std::optional<double> taylor_quinney_factor;
  };
  for (const Case& of : {Case{"slips", 150e6, {}}, Case{"flows and slips", 260e6, {}}, Case{"flows", 2e9, {}},
                         Case{"slips, all heats", 150e6, 0.9}, Case{"flows, all heats", 2e9, 0.9}}) {
    double before = 0.0;
    for (const int refined : {1, 2, 4}) {
      MasslessPair pair(of.interface_strength, of.taylor_quinney_factor);
      const int steps = 100 * refined;
      double worst_jump = 0.0, worst_T0 = 0.0;
      bool slipped = false;
      for (int n = 0; n < steps; ++n) {
        pair.step(MasslessPair::kTime / steps);
        worst_jump = std::max(worst_jump, pair.jumps_apart());
        worst_T0 = std::max(worst_T0, pair.temperatures_apart());
        slipped = slipped || pair.slips();
      }
      const double worst = std::max(worst_jump, worst_T0);
      const bool flowed = pair.waves.plastic_slip(0) > 1e-9;
      std::printf("  %-18s %4d steps: [V] %.2e, T0 %.2e apart; slipped %d, flowed %d\n", of.name, steps, worst_jump,
                  worst_T0, slipped, flowed);
      EXPECT_EQ(flowed, of.interface_strength > 200e6);
      if (refined > 1) {
        EXPECT_LT(worst, 0.7 * before) << of.name;
      }
      before = worst;
    }
    EXPECT_LT(before, 5e-3) << of.name;
  }
}

// Where all work heats and a layer hardens until its contact slips, both layers slip from the same step on. Without
// inertia z = 0 has the heat of that whole step; waves put heat where their work is done before it softens the
// contact, so that the layer takes the share of the step in which it still flows. T0 of this step differs by the slip
// of that share, which falls with the root of dt; then it is as if slip had begun later by that share of a step.
TEST(PhysicsWavesForced, SlipThatBeginsWithinAStepHeatsFromThenOn) {
  constexpr double kStrength = 260e6;
  std::printf("flows, then slips, all heats: steps, share that flows, T0 apart in that step, after 50 ns\n");
  for (const int refined : {1, 4, 16}) {
    MasslessPair pair(kStrength, 0.9);
    const int steps = 100 * refined;
    double stress = 0.0, T0 = 0.0, T0_rigid = 0.0, stress_before = 0.0, T0_before = 0.0;
    double share = 0.0, apart = 0.0, worst = 0.0;
    for (int n = 0; n < steps; ++n) {
      const bool slipped = pair.slips();
      stress_before = std::exchange(stress, pair.waves.outputs.shear_stress[0]);
      T0_before = std::exchange(T0, pair.waves.T(0));
      T0_rigid = pair.rigid.T(0);
      pair.step(MasslessPair::kTime / steps);
      if (n >= steps / 2) worst = std::max(worst, pair.temperatures_apart());
      if (slipped || !pair.slips()) continue;
      ASSERT_GT(pair.rigid.outputs.sliding_velocity[0], 1.0);
      // The stress would have gone on to rise, up to what the contact carries.
      const double most =
          kStrength / kSqrt3 * softening(pair.options.soft, MasslessPair::kCompression, 2.0 * T0 - T0_before).g;
      share = (most - stress) / (stress - stress_before);
      apart = pair.temperatures_apart();
      EXPECT_GT(share, 0.0);
      EXPECT_LT(share, 1.0);
      EXPECT_NEAR((pair.waves.T(0) - T0) / (pair.rigid.T(0) - T0_rigid), 1.0 - share, 0.05);
    }
    std::printf("  %5d  %.3f  %.2e  %.2e\n", steps, share, apart, worst);
    EXPECT_GT(share, 0.0);
    EXPECT_LT(worst, (0.8e-3 + 5e-3 * share) / refined);
  }
}

// Work that heats in place, of a layer that flows and waves that cross it: order in time.
TEST(PhysicsWavesForced, WorkThatHeatsInPlaceIsOfFirstOrderInTime) {
  ModelOptions options = with_inertia(two_sided(graded(paper_options(Strategy::kForceDriven))));
  options.plastic_layer = true;
  options.taylor_quinney_factor = 0.9;
  options.interface = {.friction_coefficient = 1.0, .yield_strength = 2e9};
  struct Answer {
    double jump, temperature;
  };
  const auto after = [&](int steps) {
    Rig rig(options, 1);
    rig.set_all(0.0, 11.2e9);
    double heat = 0.0;
    const double dt = 200e-9 / steps;
    for (int n = 0; n < steps; ++n) {
      const double push = 3e8 * std::pow(std::sin(M_PI * std::min((n + 0.5) * dt / 200e-9, 0.5)), 2);
      go_on(rig, push, n == 0);
      rig.inputs.stress_hard[0] = push;
      rig.step(dt);
      heat += rig.outputs.friction_heat[0];
    }
    EXPECT_NEAR(rig.stored_heat(300.0) / heat, 1.0, 1e-10);
    return Answer{rig.outputs.velocity_jump_new[0], rig.outputs.interface_temperature[0]};
  };
  std::printf("pushed for 200 ns, work heats in place: steps, [V], T0, orders\n");
  Answer before{}, step{};
  for (const int steps : {200, 400, 800, 1600}) {
    const Answer found = after(steps);
    const Answer moved{found.jump - before.jump, found.temperature - before.temperature};
    const double orders[] = {std::log2(std::abs(step.jump / moved.jump)),
                             std::log2(std::abs(step.temperature / moved.temperature))};
    std::printf("  %5d  %11.6f m/s  %10.5f K  %6.3f  %6.3f\n", steps, found.jump, found.temperature, orders[0],
                orders[1]);
    if (steps == 1600) {
      EXPECT_NEAR(orders[0], 1.0, 0.3);
      EXPECT_NEAR(orders[1], 1.0, 0.3);
    }
    step = moved;
    before = found;
  }
  EXPECT_GT(before.temperature, 350.0);
}

}  // namespace
}  // namespace shearbus::testing
