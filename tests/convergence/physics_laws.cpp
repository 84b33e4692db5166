// Flow laws and friction laws that are not in the DLP paper, compared with exact solutions or with solutions by another
// method.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "tests/support/orders.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

// Copper with Johnson and Cook's law and without thermal softening. All cells of the layer (thickness h, velocity jump
// v) have the same state. The stress is s = G0 (v t/h - sqrt(3) ep), and one equation remains, with the constants r0,
// A, B, n and C of the law: d ep/dt = r0 exp((sqrt(3) s / (A + B ep^n) - 1) / C).
ModelOptions cold_copper() {
  ModelOptions options = graded(paper_options(), 4, 1.0);
  Material& soft = options.soft;
  soft.yield_strength = 90e6;
  soft.hardening_exponent = 0.31;
  soft.shear_modulus = 46e9;
  soft.melting_temperature = 1e5;
  follow_johnson_cook(soft, 292e6, 0.025, 1.0, 20.0, 300.0);
  return options;
}

// Returns ep(t_end) of d ep/dt = rate(t, ep) by the Runge-Kutta method of order 4.
template <class Rate>
double strain_by_runge_kutta(const Rate& rate, double t_end, int steps) {
  const double dt = t_end / steps;
  double ep = 0.0;
  for (int n = 0; n < steps; ++n) {
    const double t = n * dt;
    const double k1 = rate(t, ep), k2 = rate(t + dt / 2, ep + dt / 2 * k1);
    const double k3 = rate(t + dt / 2, ep + dt / 2 * k2), k4 = rate(t + dt, ep + dt * k3);
    ep += dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
  }
  return ep;
}

// The stress that the layer has where it is elastic but for the strain ep.
double elastic_stress(const ModelOptions& options, double v, double t, double ep) {
  return options.soft.shear_modulus * (v * t / options.grid.thickness - std::sqrt(3.0) * ep);
}

// Steps are far below the relaxation time C A / (3 G0 d ep/dt) of 5 ps.
double strain_of_shear(const ModelOptions& options, double v, double t_end, int steps) {
  const Material& m = options.soft;
  const auto rate = [&](double t, double ep) {
    const double strength = m.yield_strength + m.hardening_modulus * std::pow(ep, m.hardening_exponent);
    const double over = std::sqrt(3.0) * elastic_stress(options, v, t, ep) / strength - 1.0;
    return over > 0.0 ? m.reference_strain_rate * std::exp(over / m.rate_coefficient) : 0.0;
  };
  return strain_by_runge_kutta(rate, t_end, steps);
}

// Compares the stress of sheared layers with the exact one, whose plastic strain is ep. From `expected_below` on the
// steps have their order, 1. Returns the error of the shortest steps.
double sheared(const char* name, const ModelOptions& options, double pressure, double ep, double even,
               std::initializer_list<double> step_lengths, double within, double expected_below = 1.0) {
  constexpr double kJump = 100.0, kEnd = 100e-9;
  const double s = elastic_stress(options, kJump, kEnd, ep);
  std::printf("%s copper, 100 m/s, at 100 ns: s %.6f MPa, ep %.8f\n", name, s / 1e6, ep);
  Orders orders("dt: s", 1.0, within);
  for (const double dt : step_lengths) {
    Rig rig(options, 1);
    rig.set_all(kJump, pressure);
    for (int n = 0; n < std::lround(kEnd / dt); ++n) rig.step(dt);
    EXPECT_NEAR(rig.ep(0), rig.ep(4), even * ep);
    orders.add(dt, std::abs(rig.stress() / s - 1.0), dt < expected_below);
  }
  return orders.last();
}

TEST(PhysicsJohnsonCookConvergence, RateDependentShearIsFirstOrderInTime) {
  const ModelOptions options = cold_copper();
  const double ep = strain_of_shear(options, 100.0, 100e-9, 400000);
  ASSERT_NEAR(strain_of_shear(options, 100.0, 100e-9, 200000), ep, 1e-10 * ep);  // the reference has converged
  EXPECT_LT(sheared("Johnson-Cook", options, 11.2e9, ep, 1e-9, {4e-9, 2e-9, 1e-9, 0.5e-9, 0.25e-9}, 0.15), 1e-4);
}

// Copper by Preston, Tonks and Wallace, held at 300 K by a hard body that takes all the heat. Only d ep/dt = r remains,
// where r solves Y(ep, r) = sqrt(3) G0 (v t / h - sqrt(3) ep), with the jump v and the thickness h; r = 0 while the
// layer is elastic.
ModelOptions cooled_copper() {
  ModelOptions options = graded(paper_options(), 4, 1.0);
  options.soft = make_material("copper_ofhc_ptw", {}).material;
  options.hard.conductivity = 1e15;
  options.initial_temperature = 300.0;
  return options;
}

double rate_under(const Material& m, double stress, double ep, double pressure) {
  double lo = std::log(1e-3), hi = std::log(1e15);
  const auto carries = [&](double log_rate) { return flow_stress(m, ep, pressure, 300.0, std::exp(log_rate)); };
  if (carries(lo) >= std::sqrt(3.0) * stress) return 0.0;
  for (int i = 0; i < 60; ++i) {
    const double mid = 0.5 * (lo + hi);
    (carries(mid) < std::sqrt(3.0) * stress ? lo : hi) = mid;
  }
  return std::exp(lo);
}

// Steps are below the relaxation time dY/dln(r) / (3 G0 r) of 0.1 ns.
double strain_of_preston_shear(const ModelOptions& options, double v, double pressure, double t_end, int steps) {
  const auto rate = [&](double t, double ep) {
    return rate_under(options.soft, elastic_stress(options, v, t, ep), ep, pressure);
  };
  return strain_by_runge_kutta(rate, t_end, steps);
}

TEST(PhysicsPrestonTonksWallaceConvergence, CoupledShearIsFirstOrderInTime) {
  const ModelOptions options = cooled_copper();
  const double pressure = 11.2e9, ep = strain_of_preston_shear(options, 100.0, pressure, 100e-9, 8000);
  // the reference has converged
  ASSERT_NEAR(strain_of_preston_shear(options, 100.0, pressure, 100e-9, 4000), ep, 1e-6 * ep);
  // the onset of flow is resolved only by steps below 3 ns
  EXPECT_LT(sheared("Preston-Tonks-Wallace", options, pressure, ep, 1e-6, {8e-9, 4e-9, 2e-9, 1e-9, 0.5e-9}, 0.05, 3e-9),
            2e-6);
}

ModelOptions hot_copper() {
  ModelOptions options = graded(cold_copper(), 60, 1.08);
  options.soft.melting_temperature = 1356.0;
  options.soft.thermal_exponent = 1.09;
  return options;
}

// With heat and softening there is no exact solution, so the order is computed from the differences between runs with
// different step lengths. The interface slips from the start, because a layer that is loaded from rest begins to flow
// somewhere within a step and then has no definite order.
TEST(PhysicsJohnsonCookConvergence, HotSlipIsFirstOrderInTime) {
  ModelOptions options = hot_copper();
  options.drive = Drive::kInterfaceSlip;
  Orders orders("Johnson-Cook copper heated by slip, 100 m/s, at 200 ns, dt: change of T0", 1.0, 0.15);
  double T_before = 0.0;
  for (double dt : {4e-9, 2e-9, 1e-9, 0.5e-9, 0.25e-9}) {
    Rig rig(options, 1);
    rig.set_all(100.0, 11.2e9);
    for (int n = 0; n < std::lround(200e-9 / dt); ++n) rig.step(dt);
    if (T_before != 0.0) orders.add(dt, rig.T(0) - T_before);
    T_before = rig.T(0);
  }
}

TEST(PhysicsJohnsonCookConvergence, HotShearAgreesBetweenStepLengthsAndGrids) {
  const auto run = [](const ModelOptions& options, double dt) {
    Rig rig(options, 1);
    rig.set_all(100.0, 11.2e9);
    for (int n = 0; n < std::lround(500e-9 / dt); ++n) rig.step(dt);
    std::printf("Johnson-Cook copper, layer shear, 500 ns: dt %.2g s, %d cells: s %.4f MPa, T0 %.3f K\n", dt,
                options.grid.cells, rig.stress() / 1e6, rig.T(0));
    return std::pair(rig.stress(), rig.T(0));
  };
  const auto [s, T0] = run(hot_copper(), 1e-9);
  for (const auto& [s_other, T0_other] : {run(hot_copper(), 0.25e-9), run(graded(hot_copper(), 120, 1.04), 1e-9)}) {
    EXPECT_NEAR(s_other / s, 1.0, 5e-4);
    EXPECT_NEAR(T0_other, T0, 0.5);
  }
}

// Velocity-weakening friction slows two free bodies of masses m- and m+ down:
//   dV/dt = -k (mu_inf + (mu_0 - mu_inf) exp(-theta V)),  k = P (1/m- + 1/m+)
// The exact solution, with r = mu_0/mu_inf - 1, is
//   exp(theta V) = (exp(theta V0) + r) exp(-k theta mu_inf t) - r
// A step uses the friction at the mean slip velocity of the step, so the order is two.
TEST(PhysicsVelocityWeakeningConvergence, SlipIsSecondOrderInTime) {
  ModelOptions options = graded(paper_options(Strategy::kForceDriven), 4, 1.0);
  options.interface = {0.3, 1e12, FrictionLaws::place<VelocityWeakening>(), 0.02, 0.01};
  const double P = 1e9, m = 0.05, V0 = 300.0, t_end = 80e-9;
  const auto exact = [&](double t) {
    const double k = P * 2.0 / m, r = 0.3 / 0.02 - 1.0;
    return std::log((std::exp(0.01 * V0) + r) * std::exp(-k * 0.01 * 0.02 * t) - r) / 0.01;
  };
  ASSERT_GT(exact(t_end), 50.0);
  Orders orders("velocity weakening from 300 m/s, dt: [V]", 2.0, 0.1);
  for (double dt : {8e-9, 4e-9, 2e-9, 1e-9, 0.5e-9}) {
    Rig rig(options, 1);
    rig.set_all(V0, P);
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = m;
    double dissipated = 0.0;
    for (int n = 0; n < std::lround(t_end / dt); ++n) {
      rig.step(dt);
      ASSERT_EQ(rig.outputs.outcome[0], 0);
      dissipated += rig.outputs.shear_stress[0] * rig.outputs.sliding_velocity[0] * dt;
      rig.inputs.velocity_jump[0] = rig.outputs.velocity_jump_new[0];
    }
    const double V = rig.inputs.velocity_jump[0];
    // The heat is the loss of kinetic energy of the relative motion, in which two bodies of mass m have the mass m/2.
    EXPECT_NEAR(dissipated, 0.25 * m * (V0 * V0 - V * V), 1e-9 * dissipated);
    orders.add(dt, std::abs(V - exact(t_end)));
  }
}

// Velocity-weakening friction brakes two free bodies until they stop, where exp(theta V) = 1. Afterwards the bodies
// stay at rest.
TEST(PhysicsVelocityWeakeningConvergence, TheTimeOfStoppingConverges) {
  ModelOptions options = graded(paper_options(Strategy::kForceDriven), 4, 1.0);
  options.interface = {0.3, 1e12, FrictionLaws::place<VelocityWeakening>(), 0.02, 0.01};
  const double P = 1e9, m = 0.05, V0 = 300.0, k = P * 2.0 / m, r = 0.3 / 0.02 - 1.0;
  const double stop = std::log((std::exp(0.01 * V0) + r) / (1.0 + r)) / (k * 0.01 * 0.02);
  for (double dt : {10e-9, 2.5e-9}) {
    Rig rig(options, 1);
    rig.set_all(V0, P);
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = m;
    int n = 0;
    while (rig.outputs.regime[0] != Regime::kStick && n < 1000) {
      rig.step(dt);
      rig.inputs.velocity_jump[0] = rig.outputs.velocity_jump_new[0];
      ++n;
    }
    EXPECT_NEAR(n * dt, stop, 1.01 * dt);
    for (int more = 0; more < 10; ++more) rig.step(dt);
    EXPECT_EQ(rig.outputs.velocity_jump_new[0], 0.0);
  }
}

// A body slides at constant V, and its friction falls in proportion to the rise of T0: the softening exponent is 1, and
// the reference temperature is the initial temperature. The initial heat flux is q0, and friction vanishes at the rise
// R. The heat flux q0 (1 - rise/R) is that of a surface heated by convection from a fluid that is hotter by R, with the
// coefficient q0/R. For this surface Carslaw and Jaeger give rise = R (1 - exp(x^2) erfc(x)), x = q0 sqrt(alpha t) /
// (k R). The flux begins as q0 (1 - c sqrt(t)), which no uniform step resolves, so the order of SDIRK2 is 3/2.
TEST(PhysicsThermalSofteningConvergence, HeatingIsThatOfAConvectiveSurface) {
  ModelOptions options = paper_options(Strategy::kForceDriven);
  options.soft.temperature_coefficient = 0.0;
  options.interface = {0.05, 1e12, FrictionLaws::place<ThermalSoftening>()};
  options.interface.friction_reference_temperature = options.initial_temperature;
  options.interface.friction_softening_exponent = 1.0;
  options.modes = {.accuracy = 1e-9, .shortest_step = 1e-11, .longest_time = 1e-5};
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  const double P = 2e9, V = 200.0, t = 200e-9;
  const Material& m = options.soft;
  const double R = m.melting_temperature - options.initial_temperature;
  const double q0 = heat_partition(options.soft, options.hard) * 0.05 * P * V;
  const double x = q0 * std::sqrt(m.diffusivity * t) / (m.conductivity * R);
  const double exact = R * (1.0 - std::exp(x * x) * std::erfc(x));
  ASSERT_GT(exact, 0.3 * R);
  ASSERT_LT(exact, 0.9 * R);
  for (const TimeIntegrator integrator : {TimeIntegrator::kBackwardEuler, TimeIntegrator::kSdirk2}) {
    const bool second = integrator == TimeIntegrator::kSdirk2;
    options.time_integrator = integrator;
    Orders orders(second ? "friction softening, sdirk2, steps: T0" : "friction softening, backward Euler, steps: T0",
                  second ? 1.5 : 1.0, 0.1);
    for (const int steps : {25, 50, 100, 200}) {
      Rig rig(options, 1);
      rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e12;
      rig.set_all(V, P);
      for (int n = 0; n < steps; ++n) {
        rig.step(t / steps);
        ASSERT_EQ(rig.outputs.outcome[0], 0);
        ASSERT_EQ(rig.outputs.regime[0], Regime::kCoulomb);
      }
      orders.add(steps, std::abs(rig.outputs.interface_temperature[0] - options.initial_temperature - exact));
    }
    EXPECT_LT(orders.last(), second ? 1e-3 * exact : 1e-2 * exact);
  }
}

}  // namespace
}  // namespace shearbus::testing
