// Melting and freezing against exact solutions: Neumann's two-phase Stefan problem between two half-spaces, the steady
// film between two baths with viscous heating; and a pulse of slip that melts the interface and lets it freeze again.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <vector>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

constexpr double kLatentHeat = 397e3;

ModelOptions melting_options() {
  ModelOptions options = paper_options(Strategy::kForceDriven);
  options.melt_film = MeltFilmOptions{.latent_heat = kLatentHeat, .viscosity = 1.25e-3, .activation_energy = 0.0};
  return options;
}

double root(const std::function<double(double)>& falling, double lo, double hi) {
  for (int i = 0; i < 200; ++i) {
    const double mid = 0.5 * (lo + hi);
    (falling(mid) > 0.0 ? lo : hi) = mid;
  }
  return 0.5 * (lo + hi);
}

// ---- Neumann's solution ----

// The soft half-space starts at T_soft, all liquid or all solid; the hard one at T_hard. The front, at which the soft
// body freezes or melts, is at z = 2 lambda sqrt(alpha t); T(0) is constant in time.
struct Neumann {
  double lambda, T0;
};
Neumann neumann(const ModelOptions& o, double T_soft, double T_hard) {
  const double e = o.soft.conductivity / std::sqrt(o.soft.diffusivity);
  const double e_hard = o.hard.conductivity / std::sqrt(o.hard.diffusivity);
  const double T_melt = o.soft.melting_temperature;
  const double rise = o.soft.density * kLatentHeat * o.soft.diffusivity / o.soft.conductivity;
  const double sign = T_hard < T_melt ? 1.0 : -1.0;  // freezes or melts
  const auto T0 = [&](double lambda) {
    const double conducts = e / std::erf(lambda);
    return (e_hard * T_hard + conducts * T_melt) / (e_hard + conducts);
  };
  const auto excess = [&](double lambda) {
    return sign * std::exp(-lambda * lambda) *
               ((T_melt - T0(lambda)) / std::erf(lambda) - (T_soft - T_melt) / std::erfc(lambda)) -
           lambda * std::sqrt(M_PI) * rise;
  };
  const double lambda = root(excess, 1e-6, 3.0);
  return {lambda, T0(lambda)};
}

struct StefanError {
  double front, T0;  // relative error of the thickness of the new phase; error of T(0) [K]
};
StefanError stefan_error(double T_soft, double T_hard, int cells, int steps) {
  ModelOptions options = melting_options();
  const double end = 20e-9;
  const double depth = 6.0 * std::sqrt(options.soft.diffusivity * end);
  options.grid = {depth, cells, 1.0, FarBoundary::kInsulated, false};
  options = two_sided(options);
  options.initial_temperature = T_soft;
  Rig rig(options, 1);
  rig.start_hard(T_hard);
  rig.set_all(0.0, -1.0);  // an open contact conducts only
  const bool liquid = T_hard < options.soft.melting_temperature;
  if (liquid) std::fill_n(rig.committed.begin() + rig.model.layout().liquid_fraction, (cells + 1) * kLanes, 1.0);
  for (int n = 0; n < steps; ++n) rig.step(end / steps);
  const Neumann exact = neumann(options, T_soft, T_hard);
  const double grown = liquid ? depth - rig.film_thickness() : rig.film_thickness();
  const double front = 2.0 * exact.lambda * std::sqrt(options.soft.diffusivity * end);
  return {std::abs(grown / front - 1.0), std::abs(rig.T(0) - exact.T0)};
}

TEST(PhysicsStefan, FrontAndTemperatureConvergeToNeumannsSolution) {
  struct Case {
    const char* name;
    double T_soft, T_hard;
  };
  for (const Case& c : {Case{"one phase freezes", 1220.0, 300.0}, Case{"two phases, freezes", 1500.0, 300.0},
                        Case{"two phases, melts", 900.0, 2300.0}}) {
    std::vector<StefanError> errors;
    for (const int k : {1, 2, 4, 8}) {
      errors.push_back(stefan_error(c.T_soft, c.T_hard, 60 * k, 100 * k));
      std::printf("%s: %d cells, %d steps: front %.2e, T0 %.2e K\n", c.name, 60 * k, 100 * k, errors.back().front,
                  errors.back().T0);
    }
    // First order: eight times finer makes the errors at least four times smaller. The front's position wobbles by a
    // part of a cell, so single halvings do not show the order.
    EXPECT_LT(errors.back().front, errors.front().front / 4.0) << c.name;
    EXPECT_LT(errors.back().T0, errors.front().T0 / 4.0) << c.name;
    EXPECT_LT(errors.back().front, 0.02) << c.name;
    EXPECT_LT(errors.back().T0, 2.0) << c.name;
  }
}

// ---- The steady film between two baths ----

// Both bodies are held at their start temperature at a depth of 2 um. The film releases s v, which leaves through them.
struct Couette {
  double thickness, velocity, flux;  // relative deviations of the film from its differential equation
  double rise;                       // of the hottest vertex above melting  [K]
};
Couette couette(double activation_energy, int cells) {
  constexpr double kDepth = 2e-6, kJump = 160.0;
  ModelOptions options = melting_options();
  options.melt_film->viscosity = 1.0;
  options.melt_film->activation_energy = activation_energy;
  options.interface = {0.3, 2e9};
  options.initial_temperature = 800.0;
  options.grid = {kDepth, cells, 1.0, FarBoundary::kIsothermal, false};
  options = two_sided(options, GridOptions{kDepth, cells, 1.0, FarBoundary::kIsothermal, false});
  options.hard.conductivity = 60.0;
  options.hard.diffusivity = 2e-5;
  Rig rig(options, 1);
  rig.set_all(kJump, 5e9);
  rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e12;
  const double k = options.soft.conductivity, T_melt = options.soft.melting_temperature;
  for (int n = 0; n < 4000; ++n) rig.step(2e-9);

  // Integrates k T'' = -s^2/eta(T) from z = 0 to the front, from T(0) and the flux into the hard body.
  const double s = rig.stress(), R = 8.31446261815324;
  const auto fluidity = [&](double T) {
    return std::exp(-activation_energy / R * (1.0 / T - 1.0 / T_melt)) / options.melt_film->viscosity;
  };
  double z = 0.0, T = rig.T(0), v = 0.0;
  double slope = options.hard.conductivity * (T - options.initial_temperature) / (kDepth * k);
  const double dz = kDepth / 2e5;
  while (z < kDepth && (slope > 0.0 || T > T_melt)) {
    const double middle = T + 0.5 * dz * slope;
    v += s * fluidity(middle) * dz;
    const double next = slope - dz * s * s * fluidity(middle) / k;
    T += 0.5 * dz * (slope + next);
    slope = next;
    z += dz;
  }
  double hottest = 0.0;
  for (int i = 0; i <= cells; ++i) hottest = std::max(hottest, rig.T(i));
  const double leaves = k * (T_melt - options.initial_temperature) / (kDepth - z);
  return {z / rig.film_thickness() - 1.0, v / kJump - 1.0, -k * slope / leaves - 1.0, hottest - T_melt};
}

TEST(PhysicsCouetteFilm, TheSteadyFilmSolvesItsDifferentialEquation) {
  for (const double activation_energy : {0.0, 60e3}) {
    std::vector<double> worst;
    for (const int cells : {25, 50, 100}) {
      const Couette film = couette(activation_energy, cells);
      std::printf("E = %g: %d cells: thickness %.1e, velocity %.1e, flux %.1e; %.1f K above melting\n",
                  activation_energy, cells, film.thickness, film.velocity, film.flux, film.rise);
      EXPECT_GT(film.rise, 15.0);
      worst.push_back(std::max({std::abs(film.thickness), std::abs(film.velocity), std::abs(film.flux)}));
    }
    EXPECT_LT(worst.back(), worst.front() / 2.5);
    EXPECT_LT(worst.back(), 0.03);
  }
}

// ---- A pulse of slip ----

struct Pulse {
  double work = 0.0, thickest = 0.0;  // [J/m2], [m]
  int changes = 0;                    // how often the film appears or vanishes
  int turns = 0;                      // how often its growth changes sign
  int bumps = 0;                      // how often the stress rises on the plateau of the jump while there is a film
  double frozen_at = 0.0;             // [s]
};
Pulse pulse(double dt) {
  ModelOptions options = graded(melting_options(), 60, 1.1);
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  options = two_sided(options);
  Rig rig(options, 1);
  rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e12;
  Pulse found;
  double film = 0.0, stress = 0.0, grew = 0.0;
  for (int n = 1; n * dt <= 600e-9 * (1 + 1e-9); ++n) {
    const double t = n * dt;
    const double jump = 300.0 * std::clamp(std::min(t, 400e-9 - t) / 50e-9, 0.0, 1.0);
    rig.set_all(jump, 11.2e9);
    rig.step(dt);
    const double now = rig.film_thickness();
    found.work += rig.outputs.friction_heat[0];
    found.thickest = std::max(found.thickest, now);
    if ((now > 0.0) != (film > 0.0)) {
      ++found.changes;
      found.frozen_at = t;
    }
    if ((now - film) * grew < 0.0) ++found.turns;
    if (now != film) grew = now - film;
    if (film > 0.0 && t > 51e-9 && t < 349e-9 && rig.stress() > stress * (1.0 + 1e-12)) ++found.bumps;
    film = now;
    stress = rig.stress();
  }
  EXPECT_EQ(film, 0.0);
  return found;
}

TEST(PhysicsMeltPulse, SolidFilmSolidWithoutChatterAndOfFirstOrder) {
  std::vector<Pulse> runs;
  for (const double dt : {1e-9, 0.25e-9, 0.0625e-9}) {
    runs.push_back(pulse(dt));
    const Pulse& run = runs.back();
    std::printf("dt %g ns: work %.6g kJ/m2, thickest %.6g nm, frozen at %.5g ns; %d changes, %d turns, %d bumps\n",
                dt * 1e9, run.work / 1e3, run.thickest * 1e9, run.frozen_at * 1e9, run.changes, run.turns, run.bumps);
    EXPECT_EQ(run.changes, 2);
    EXPECT_EQ(run.turns, 1);
    EXPECT_EQ(run.bumps, 0);
  }
  const auto order = [&](double Pulse::*figure) {
    const double coarse = runs[0].*figure - runs[1].*figure, fine = runs[1].*figure - runs[2].*figure;
    return std::log(std::abs(coarse / fine)) / std::log(4.0);
  };
  std::printf("orders: work %.2f, thickness %.2f\n", order(&Pulse::work), order(&Pulse::thickest));
  EXPECT_GT(order(&Pulse::work), 0.7);
  EXPECT_GT(order(&Pulse::thickest), 0.7);
}

}  // namespace
}  // namespace shearbus::testing
