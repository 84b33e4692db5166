// Random scenes and inputs, extremes included, for property tests. Seeds are fixed: a failure repeats.
#pragma once

#include <cmath>
#include <random>

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
  if (strategy == Strategy::kForceDriven) options.plastic_layer = draw.chance(0.5);
  if (!options.taylor_quinney_factor && !options.plastic_layer && draw.chance(0.4))
    options.time_integrator = TimeIntegrator::kSdirk2;
  if (strategy == Strategy::kForceDriven && !options.hard_grid && !options.plastic_layer && draw.chance(0.7)) {
    options.modes = {.accuracy = 1e-4, .shortest_step = extreme ? 1e-12 : 1e-10, .longest_time = extreme ? 1e-3 : 1e-6};
  }
  options.initial_temperature = draw.chance(0.3) ? 1220.0 - draw.log_uniform(1e-6, 100.0) : draw.uniform(1.0, 1200.0);
  return options;
}

inline double random_dt(Draw& draw, bool extreme) {
  return extreme ? draw.log_uniform(1e-12, 1e-5) : draw.log_uniform(1e-10, 1e-8);
}

// Inputs of all lanes for one step. Mostly a small change of the last, now and then something else altogether.
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
      in.mass_minus[l] = draw.log_uniform(extreme ? 1e-30 : 1e-3, extreme ? 1e30 : 1.0);
      in.mass_plus[l] = draw.log_uniform(extreme ? 1e-30 : 1e-3, extreme ? 1e30 : 1.0);
    }
    if (rig.model.options().plastic_layer) {
      in.soft_plastic_rate[l] = draw.chance(0.5) ? 0.0 : draw.log_uniform(1.0, extreme ? 1e10 : 1e6);
    }
    in.stress_minus[l] = draw.chance(0.1) ? 0.0 : draw.sign() * draw.log_uniform(1e3, extreme ? 1e12 : 1e9);
    in.stress_plus[l] = draw.chance(0.1) ? 0.0 : draw.sign() * draw.log_uniform(1e3, extreme ? 1e12 : 1e9);
  }
}

}  // namespace shearbus::testing
