// Shear waves in the layers of a tile: the step of waves.hpp for several lanes at once, by Newton's method alone.
#pragma once

#include <cstdint>

#include "server/physics/layer/grid.hpp"
#include "server/physics/layer/lanes.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

struct WideWaveStep {
  const Material* soft;  // material of the soft body, where it does not depend on pressure
  const Grid* grid;
  const double* response;                                  // response B of each vertex  [K m2/W]
  double dt;                                               // length of the step  [s]
  double heat_share;                                       // share of the friction heat that enters the heat equation
  alignas(64) double T_melt[kLanes];                       // melting temperature at the pressure of each lane  [K]
  alignas(64) double bracket[kLanes];                      // bracket of the softening g at T = 0 K
  alignas(64) double jump[kLanes];                         // imposed velocity jump [V]  [m/s]
  alignas(64) double coulomb[kLanes];                      // friction limit mu P  [Pa]
  alignas(64) double give_near[kLanes], give_far[kLanes];  // how the bodies give way, WaveStep
  // Rows [vertex or cell][lane]: temperatures without friction; the state before the step, and after it in the lanes
  // that are solved.
  const double* T_ad;
  double* strain;
  double* stress;
  double* velocity;
  const double* guess = nullptr;  // velocities from which Newton's method starts; null: those before the step
  int most_steps = 6;             // Newton steps, after which the general search takes a lane
  bool tries_limit = false;       // whether the limit is tried before the stress without it, which may be far above
};

struct WideWaveAnswer {
  alignas(64) double flux[kLanes];           // heat flux q into the layer  [W/m2]
  alignas(64) double slip_along[2][kLanes];  // flow along stresses above 0, and along those below  [m]
  double interface_slip[kLanes];             // slip velocity at z = 0, without a sign  [m/s]
  double iterations[kLanes];                 // Newton steps
};

// Solves the step of `lanes` and returns those that Newton's method has solved in few steps. Rows and answers of the
// others are as before, and wait for advance_waves().
std::uint32_t advance_waves_wide(const WideWaveStep& step, std::uint32_t lanes, WideWaveAnswer& answer);

}  // namespace shearbus::physics
