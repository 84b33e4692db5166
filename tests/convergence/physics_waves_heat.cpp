// A layer with inertia whose plastic work heats it in place, against exact solutions, the layer without mass, and itself
// on finer grids and with shorter steps.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tests/support/orders.hpp"
#include "tests/support/waves.hpp"

namespace shearbus::testing {
namespace {

constexpr double kPressure = 11.2e9;  // compression of the contact [Pa]

ModelOptions heated_waves(ModelOptions options, double factor = 1.0) {
  options = with_inertia(two_sided(options));
  options.taylor_quinney_factor = factor;
  return options;
}

// A bonded layer without mass that neither conducts nor warms the hard body is sheared uniformly. Once it flows
//   V/h = sqrt(3) dep/dt + (ds/dt)/G0,   s = Y(ep, T)/sqrt(3),   rho c dT = X sqrt(3) s dep.
struct Sheared {
  double s, T;
};
Sheared exact_shear(const ModelOptions& o, double V, double t_end) {
  const Material& m = o.soft;
  const double per_volume = *o.taylor_quinney_factor / (m.conductivity / m.diffusivity);
  const auto strength = [&](double ep, double T) { return flow_stress(m, ep, kPressure, T, 0.0) / kSqrt3; };
  const double rate = V / o.grid.thickness;
  double ep = 0.0, T = o.initial_temperature;
  double t = strength(ep, T) / (m.shear_modulus * rate);  // the layer is elastic until then
  constexpr int kSteps = 20000;
  const double dt = (t_end - t) / kSteps;
  const auto flow = [&](double strain, double temperature) {  // dep/dt
    const double s = strength(strain, temperature), d = 1e-6;
    const double heats = per_volume * kSqrt3 * s;
    const double slope = (strength(strain + d, temperature + heats * d) - s) / d;
    return rate / (kSqrt3 + slope / m.shear_modulus);
  };
  for (int n = 0; n < kSteps; ++n) {
    const double first = flow(ep, T), heat = per_volume * kSqrt3 * strength(ep, T);
    const double ep_half = ep + 0.5 * dt * first, T_half = T + 0.5 * dt * first * heat;
    const double second = flow(ep_half, T_half), heat_half = per_volume * kSqrt3 * strength(ep_half, T_half);
    ep += dt * second;
    T += dt * second * heat_half;
  }
  return {strength(ep, T), T};
}

TEST(PhysicsWavesHeatConvergence, FirstOrderAgainstAdiabaticShear) {
  ModelOptions options = paper_options();
  options.soft.density *= 1e-9;
  for (Material* body : {&options.soft, &options.hard}) {
    body->diffusivity *= 1e-9;
    body->conductivity *= 1e-9;
  }
  options.hard.conductivity *= 1e-9;
  options = heated_waves(options, 0.9);
  const Sheared exact = exact_shear(options, 100.0, 150e-9);
  std::printf("adiabatic shear, 100 m/s, 150 ns: exact %.6f MPa, %.4f K\n", exact.s / 1e6, exact.T);
  Orders stress("dt, adiabatic shear: s", 1.0, 0.15), temperature("dt, adiabatic shear: T", 1.0, 0.15);
  for (double dt : {3e-9, 1.5e-9, 0.75e-9, 0.375e-9}) {
    Rig rig(options, 1);
    rig.set_all(0.0, kPressure);
    rig.step(1e-15);  // closes the contact
    rig.set_all(100.0, kPressure);
    for (int n = static_cast<int>(std::lround(150e-9 / dt)); n > 0; --n) rig.step(dt);
    stress.add(dt, std::abs(rig.stress() - exact.s));
    temperature.add(dt, std::abs(rig.T(30) - exact.T));
  }
  EXPECT_LT(stress.last(), 1e-3 * exact.s);
  EXPECT_LT(temperature.last(), 0.5);
}

// Without mass the layer is that of the velocity-driven step, which heats with the elastic work as well: a stiff metal has
// little. Both put the heat where the step before had it, by rules of their own, so that the rest falls with the step.
TEST(PhysicsWavesHeatConvergence, WithoutMassItIsTheUniformLayer) {
  ModelOptions options = graded(paper_options());
  options.soft.density *= 1e-9;
  options.soft.shear_modulus *= 1e3;
  options = heated_waves(options);
  ModelOptions uniform_options = options;
  uniform_options.inertia = false;
  std::printf("to 100 m/s in 50 ns, 150 ns: dt, largest differences of s and T0 to the uniform layer\n");
  double before[2] = {};
  for (double dt : {2e-9, 1e-9, 0.5e-9, 0.25e-9}) {
    Rig uniform(uniform_options, 1), waves(options, 1);
    double apart[2] = {};
    for (int n = 1; n * dt < 150e-9 + 0.5 * dt; ++n) {
      const double V = 50.0 * (1.0 - std::cos(M_PI * std::min(n * dt / 50e-9, 1.0)));
      for (Rig* rig : {&uniform, &waves}) {
        rig->set_all(V, kPressure);
        rig->step(dt);
      }
      if (n * dt < 50e-9) continue;
      apart[0] = std::max(apart[0], std::abs(waves.stress() - uniform.stress()));
      apart[1] = std::max(apart[1], std::abs(waves.T(0) - uniform.T(0)));
    }
    std::printf("  %8.3g s  %10.3e Pa  %10.3e K\n", dt, apart[0], apart[1]);
    if (before[1] != 0.0) {
      EXPECT_LT(apart[1], 0.55 * before[1]);
    }
    std::copy_n(apart, 2, before);
  }
  EXPECT_LT(before[0], 100.0);
  EXPECT_LT(before[1], 0.012);
}

struct Answer {
  double stress, temperature;
};
// The paper's layer under a jump that rises to 100 m/s in 100 ns.
Answer after(const ModelOptions& options, double dt, double t_end) {
  Rig rig(options, 1);
  rig.set_all(0.0, kPressure);
  rig.step(1e-15);
  double heat = 0.0;
  for (int n = 1; n * dt < t_end + 0.5 * dt; ++n) {
    rig.set_all(50.0 * (1.0 - std::cos(M_PI * std::min(n * dt / 100e-9, 1.0))), kPressure);
    rig.step(dt);
    heat += rig.outputs.friction_heat[0];
  }
  EXPECT_NEAR(rig.stored_heat(300.0) / heat, 1.0, 1e-10);
  return {rig.stress(), rig.outputs.interface_temperature[0]};
}

TEST(PhysicsWavesHeatConvergence, FirstOrderInTimeInTheLayerOfThePaper) {
  const ModelOptions options = heated_waves(graded(paper_options()));
  std::printf("rise to 100 m/s, 150 ns: dt, s(0), T0, orders\n");
  Answer before{}, step{};
  for (double dt : {1e-9, 0.5e-9, 0.25e-9, 0.125e-9}) {
    const Answer found = after(options, dt, 150e-9);
    const Answer moved{found.stress - before.stress, found.temperature - before.temperature};
    std::printf("  %8.3g s  %10.6f MPa  %10.5f K  %6.3f  %6.3f\n", dt, found.stress / 1e6, found.temperature,
                std::log2(std::abs(step.stress / moved.stress)),
                std::log2(std::abs(step.temperature / moved.temperature)));
    if (dt < 0.4e-9) {
      EXPECT_NEAR(std::log2(std::abs(step.temperature / moved.temperature)), 1.0, 0.3);
    }
    step = moved;
    before = found;
  }
}

TEST(PhysicsWavesHeatConvergence, SecondOrderInCells) {
  const auto with_cells = [](int cells) {
    ModelOptions options = paper_options();
    options.grid.cells = cells;
    return after(heated_waves(options), 0.5e-9, 150e-9);
  };
  const Answer fine = with_cells(320);
  Orders orders("cells, rise to 100 m/s, 150 ns, dt 0.5 ns: T0 against 320 cells", 1.6, 0.0, Orders::kMore);
  for (int cells : {20, 40, 80}) orders.add(cells, std::abs(with_cells(cells).temperature - fine.temperature));
}

}  // namespace
}  // namespace shearbus::testing
