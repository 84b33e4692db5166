// Compares layers with inertia with exact solutions of the wave equations DLP (36-37): d'Alembert's elastic waves,
// plastic fronts, and the limit of a layer without mass.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <utility>

#include "tests/support/orders.hpp"
#include "tests/support/waves.hpp"

namespace shearbus::testing {
namespace {

// The paper's aluminium with a strength that depends on neither temperature nor pressure. The yield stress in shear is
// Y/sqrt(3) = 115 MPa.
ModelOptions cold_options(int cells) {
  ModelOptions options = with_inertia(paper_options());
  options.grid.cells = cells;
  options.soft.temperature_coefficient = 0.0;
  options.soft.pressure_coefficient = 0.0;
  options.soft.melting_temperature = 1e12;
  return options;
}
constexpr double kPressure = 1e9;  // compression of the contact [Pa]

double yield_stress(const Material& m) {
  return m.yield_strength / kSqrt3;
}
double crossing_time(const ModelOptions& options) {
  return options.grid.thickness / shear_speed(options.soft);
}

// Root mean square over time of the error of the stress at z = 0, relative to the largest exact stress there. The
// imposed V(t) must begin smoothly from rest, and the layer must stay elastic.
// The host imposes V at the end of each step, or with `mean` at its middle: a jump "of the step" is its mean.
struct PulseError {
  double mean_square, largest;  // root mean square and largest error, relative to the largest exact stress
};
PulseError reflection_error(ModelOptions options, double dt, const std::function<double(double)>& V, double t_end,
                            bool mean = false) {
  const double cross = crossing_time(options);
  Rig rig(options, 1);
  double squares = 0.0, largest = 0.0, farthest = 0.0;
  const int steps = static_cast<int>(std::lround(t_end / dt));
  for (int n = 1; n <= steps; ++n) {
    const double t = n * dt;
    rig.set_all(V(mean ? t - 0.5 * dt : t), kPressure);
    rig.step(dt);
    // Exact s(0): the hard body doubles every wave from z = h, and the wave returns after every two crossings of the
    // layer.
    double exact = 0.0;
    for (int k = 0; (2 * k + 1) * cross < t; ++k) exact += 2.0 * impedance(options.soft) * V(t - (2 * k + 1) * cross);
    squares += (rig.stress() - exact) * (rig.stress() - exact);
    largest = std::max(largest, std::abs(exact));
    farthest = std::max(farthest, std::abs(rig.stress() - exact));
  }
  return {std::sqrt(squares / steps) / largest, farthest / largest};
}

TEST(PhysicsWavesConvergence, FirstOrderAgainstDAlembertWithReflectionsAtBothEnds) {
  const double duration = 20e-9;  // duration of the pulse [s]; a wave crosses the layer in 6.26 ns
  const auto pulse = [&](double t) {
    const double sine = std::sin(M_PI * t / duration);
    return t < duration ? sine * sine : 0.0;
  };
  Orders orders("dt of 20 cells and more, pulse of 1 m/s over 20 ns, 40 ns: s(0)", 1.0, 0.07);
  for (int refined : {1, 2, 4, 8, 16}) {
    const double dt = 0.2e-9 / refined;
    orders.add(dt, reflection_error(cold_options(20 * refined), dt, pulse, 40e-9).mean_square, refined == 16);
  }
  EXPECT_LT(orders.last(), 6e-3);
}

// A pulse whose fifth derivative is continuous: a kink in its second one would limit the order to 5/3.
TEST(PhysicsWavesConvergence, StagesAreOfSecondOrderAgainstDAlembertWithReflectionsAtBothEnds) {
  const auto pulse = [](double t) { return t < 20e-9 ? std::pow(std::sin(M_PI * t / 20e-9), 6) : 0.0; };
  Orders orders("dt of 80 cells and more, sdirk2, pulse of 1 m/s over 20 ns, 40 ns: s(0)", 2.0, 0.06);
  for (int refined : {1, 2, 4, 8}) {
    const double dt = 0.4e-9 / refined;
    orders.add(dt, reflection_error(of_second_order(cold_options(80 * refined)), dt, pulse, 40e-9, true).mean_square);
  }
  EXPECT_LT(orders.last(), 1e-4);
}

// What is lost of a short pulse at the step length of a host: it crosses the layer in 6.26 ns, and back.
TEST(PhysicsWavesConvergence, StagesKeepAPulseThatBackwardEulerLoses) {
  const auto pulse = [](double t) { return t < 15e-9 ? std::pow(std::sin(M_PI * t / 15e-9), 2) : 0.0; };
  const ModelOptions options = cold_options(200);
  std::printf("15 ns pulse, steps of 1 ns: until, largest error of s(0) by backward Euler, by sdirk2\n");
  for (const auto& [t_end, kept] : {std::pair{20e-9, 0.05}, {60e-9, 0.2}}) {
    const double first = reflection_error(options, 1e-9, pulse, t_end, true).largest;
    const double second = reflection_error(of_second_order(options), 1e-9, pulse, t_end, true).largest;
    std::printf("  %2.0f ns  %6.3f  %6.3f\n", t_end * 1e9, first, second);
    EXPECT_GT(first, 0.3);
    EXPECT_LT(second, kept);
  }
}

// Flow, heat and waves together: the paper's layer under a jump that rises to 100 m/s in 100 ns.
TEST(PhysicsWavesConvergence, StagesAreCloserThanBackwardEulerInAHotFlowingLayer) {
  struct Answer {
    double stress, temperature;
  };
  const auto after = [](double dt, TimeIntegrator integrator) {
    ModelOptions options = with_inertia(graded(paper_options()));
    options.time_integrator = integrator;
    Rig rig(options, 1);
    rig.set_all(0.0, 11.2e9);
    rig.step(1e-15);  // closes the contact with the layer at rest
    for (int n = 1; n * dt < 600e-9 + 0.5 * dt; ++n) {
      rig.set_all(50.0 * (1.0 - std::cos(M_PI * std::min((n - 0.5) * dt / 100e-9, 1.0))), 11.2e9);
      rig.step(dt);
    }
    return Answer{rig.stress(), rig.outputs.interface_temperature[0]};
  };
  const Answer fine = after(0.0625e-9, TimeIntegrator::kSdirk2);
  std::printf("rise to 100 m/s, 600 ns: dt, error of s(0) and T0 by backward Euler, by sdirk2\n");
  for (double dt : {2e-9, 1e-9}) {
    const Answer first = after(dt, TimeIntegrator::kBackwardEuler), second = after(dt, TimeIntegrator::kSdirk2);
    const auto off = [&](const Answer& a) { return std::abs(a.stress - fine.stress); };
    const auto hot = [&](const Answer& a) { return std::abs(a.temperature - fine.temperature); };
    std::printf("  %5.2g s  %9.2e Pa %9.2e K   %9.2e Pa %9.2e K\n", dt, off(first), hot(first), off(second),
                hot(second));
    EXPECT_LT(off(second), 0.05 * off(first));
    EXPECT_LT(hot(second), 0.2 * hot(first));
  }
}

TEST(PhysicsWavesConvergence, SecondOrderInCells) {
  const auto ramp = [](double t) { return 1.0 - std::cos(M_PI * std::min(t, 10e-9) / 10e-9); };
  const auto stress = [&](int cells) {
    Rig rig(cold_options(cells), 1);
    for (int n = 1; n <= 60; ++n) {
      rig.set_all(ramp(n * 0.25e-9), kPressure);
      rig.step(0.25e-9);
    }
    return rig.stress();
  };
  const double fine = stress(800);
  Orders orders("cells, elastic ramp, dt 0.25 ns: s(0) against 800 cells", 2.0, 0.1);
  for (int cells : {10, 20, 40, 80}) orders.add(cells, std::abs(stress(cells) / fine - 1.0));
}

// A perfectly plastic layer with the shear yield stress tau and the impedance Z meets the hard body at V = 50 m/s. A
// front crosses the layer at the elastic wave speed. Behind the front the stress is s = tau and the velocity v = V -
// tau/Z, with which the layer slips on the hard body. After the front has reached the soft body, the layer slips on it
// with tau/Z, at z = h.
class PhysicsWavesFronts : public ::testing::TestWithParam<TimeIntegrator> {};
INSTANTIATE_TEST_SUITE_P(, PhysicsWavesFronts,
                         ::testing::Values(TimeIntegrator::kBackwardEuler, TimeIntegrator::kSdirk2),
                         [](const auto& test) {
                           return test.param == TimeIntegrator::kSdirk2 ? "Sdirk2" : "BackwardEuler";
                         });

TEST_P(PhysicsWavesFronts, InAPerfectlyPlasticLayer) {
  const double V = 50.0;
  std::printf("perfectly plastic layer, 50 m/s: cells, dt, mean error of s over the layer at half a crossing, order\n");
  double before = 0.0;
  for (int refined : {1, 4, 16}) {
    ModelOptions options = cold_options(50 * refined);
    options.time_integrator = GetParam();
    options.soft.hardening_coefficient = 0.0;
    const double tau = yield_stress(options.soft);
    const double Z = impedance(options.soft);
    const double cross = crossing_time(options);
    const int half = 40 * refined;
    const double dt = 0.5 * cross / half;
    Rig rig(options, 1);
    rig.set_all(V, kPressure);
    for (int n = 0; n < half; ++n) rig.step(dt);
    const Grid& grid = rig.model.grid();
    double error = 0.0;
    for (int i = 0; i < grid.num_vertices(); ++i) {
      const double exact = grid.vertex[i] < 0.5 * options.grid.thickness ? tau : 0.0;
      error += grid.weight[i] * std::abs(stress_at(rig, i) - exact) / (tau * options.grid.thickness);
    }
    const double order = before != 0.0 ? std::log(before / error) / std::log(4.0) : NAN;
    std::printf("  %4d  %8.3g s  %10.3e  %6.3f\n", grid.num_cells(), dt, error, order);
    if (before != 0.0) {
      EXPECT_GT(order, 0.45);  // near a discontinuity the order of a first-order scheme is about 1/2
    }
    before = error;
    if (refined < 16) continue;
    // Behind a jump the scheme of second order rings, which leaves plastic strain; backward Euler is monotone.
    const bool rings = GetParam() == TimeIntegrator::kSdirk2;
    EXPECT_NEAR(rig.outputs.sliding_velocity[0], V - tau / Z, (rings ? 2e-4 : 1e-6) * V);
    EXPECT_NEAR(velocity_in(rig, grid.num_cells() / 4), V - tau / Z, (rings ? 1e-3 : 1e-4) * V);
    for (int n = 0; n < 3 * half; ++n) rig.step(dt);
    for (int i = 0; i < grid.num_vertices(); ++i) EXPECT_NEAR(stress_at(rig, i), tau, 1e-9 * tau);
    EXPECT_NEAR(velocity_in(rig, grid.num_cells() / 4), V - tau / Z, (rings ? 1e-3 : 1e-4) * V);
    EXPECT_NEAR(rig.outputs.sliding_velocity[0], V, 1e-9 * V);
  }
}

// Linear hardening (exponent n = 1): above the shear yield stress tau the stress grows with the shear by the tangent
// modulus G_t. A plastic front of speed c_p = sqrt(G_t / rho) follows the elastic front. Until reflections return, s(0)
// = tau + rho c_p (V - tau / Z), with the impedance Z.
TEST_P(PhysicsWavesFronts, OfPlasticFlowInALinearlyHardeningLayer) {
  const double V = 50.0;
  std::printf("linear hardening, 50 m/s: cells, dt, error of s(0), of the plastic slip in the layer\n");
  double before = 0.0;
  for (int refined : {1, 4, 16}) {
    ModelOptions options = cold_options(50 * refined);
    options.time_integrator = GetParam();
    Material& soft = options.soft;
    soft.hardening_exponent = 1.0;
    const double rate = soft.yield_strength * soft.hardening_coefficient / 3.0;  // slope ds / d(plastic shear) [Pa]
    const double tangent = soft.shear_modulus * rate / (soft.shear_modulus + rate);
    const double plastic_speed = std::sqrt(tangent / soft.density);
    const double tau = yield_stress(soft);
    const double s = tau + soft.density * plastic_speed * (V - tau / impedance(soft));
    const int steps = 80 * refined;
    const double dt = crossing_time(options) / steps;
    Rig rig(options, 1);
    rig.set_all(V, kPressure);
    for (int n = 0; n < steps; ++n) rig.step(dt);
    const double slip = (s - tau) / rate * plastic_speed * steps * dt;
    const bool rings = GetParam() == TimeIntegrator::kSdirk2;
    const double error_s = rig.stress() / s - 1.0;
    const double error_slip = rig.plastic_slip() / slip - 1.0;
    std::printf("  %4d  %8.3g s  %10.2e  %10.2e\n", options.grid.cells, dt, error_s, error_slip);
    if (before != 0.0) {
      EXPECT_LT(std::abs(error_slip), (rings ? 0.5 : 0.35) * before);
    }
    before = std::abs(error_slip);
    if (refined < 16) continue;
    EXPECT_NEAR(error_s, 0.0, rings ? 2e-3 : 1e-4);
    EXPECT_NEAR(error_slip, 0.0, rings ? 4e-3 : 2e-3);
  }
}

// Returns the largest difference [Pa] between the stress s(0) of a layer with inertia and that of the same layer
// without inertia. It is the paper's layer at 11.2 GPa, with `density_factor` times the density of aluminium; the
// velocity jump rises to V_end [m/s] in the time `rise` [s].
double difference_to_uniform(double density_factor, double V_end, double rise, double t_end) {
  ModelOptions options = graded(paper_options());
  options.soft.density *= density_factor;
  Rig uniform(options, 1), waves(with_inertia(options), 1);
  double largest = 0.0;
  for (int n = 1; n * 1e-9 <= t_end; ++n) {
    const double t = n * 1e-9;
    const double V = 0.5 * V_end * (1.0 - std::cos(M_PI * std::min(t / rise, 1.0)));
    uniform.set_all(V, 11.2e9);
    waves.set_all(V, 11.2e9);
    uniform.step(1e-9);
    waves.step(1e-9);
    largest = std::max(largest, std::abs(waves.stress() - uniform.stress()));
  }
  return largest;
}

TEST(PhysicsWavesConvergence, WithoutMassItIsTheUniformLayer) {
  std::printf("jump to 100 m/s in 100 ns: density over aluminium's, largest difference of s to the uniform layer\n");
  double before = 0.0;
  for (double factor : {1e-1, 1e-2, 1e-3, 1e-4}) {
    const double difference = difference_to_uniform(factor, 100.0, 100e-9, 300e-9);
    std::printf("  %6.0e  %10.3e Pa\n", factor, difference);
    if (factor <= 1e-3) {
      EXPECT_NEAR(difference / before, 0.1, 0.03) << "first order in the density";
    }
    before = difference;
  }
  EXPECT_LT(difference_to_uniform(1e-15, 100.0, 100e-9, 300e-9), 1.0);
}

TEST(PhysicsWavesConvergence, SlowlyLoadedItIsTheUniformLayer) {
  std::printf("jump to 10 m/s: time it takes, largest difference of s to the uniform layer\n");
  double before = 0.0;
  for (double rise : {100e-9, 400e-9, 1600e-9}) {
    const double difference = difference_to_uniform(1.0, 10.0, rise, rise);
    std::printf("  %5.0f ns  %10.3e Pa\n", rise * 1e9, difference);
    if (before != 0.0) {
      EXPECT_LT(difference, 0.5 * before);
    }
    before = difference;
  }
}

}  // namespace
}  // namespace shearbus::testing
