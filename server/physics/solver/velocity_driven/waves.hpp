// Shear waves in the layers of a tile (MODEL.md, "Layer inertia"): DLP (36-37) with inertia, (42-48) at every vertex.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "server/physics/layer/grid.hpp"
#include "server/physics/layer/lanes.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

// Stress, plastic strain and temperature live at the vertices, velocity in the cells between them. The equations of one
// step of backward Euler, for vertices i = 0..N and cells c = 0..N-1, where v[-1] is the velocity at z = 0+ and v[N]
// the velocity of the host's soft body, both relative to the hard body:
//   weight[i] (s[i] - s_old[i]) = G0 (dt (v[i] - v[i-1]) - sqrt(3) weight[i] dep[i] sign(s[i]))         DLP (37)
//   rho width[c] (v[c] - v_old[c]) = dt (s[c+1] - s[c])                                                  DLP (36)
//   |s[i]| <= Y(ep[i], P, T[i]) / sqrt(3);   dep[i] >= 0, and dep[i] = 0 where |s[i]| < Y / sqrt(3)      DLP (42-48)
//   |s[0]| <= mu P;   v[-1] is along s[0], and v[-1] = 0 where |s[0]| < mu P
//   T = T_ad + q B,   q = share max(s[0] [V], 0)                                         DLP (18, 35)
// where share is WaveStep::heat_share. Summed over the layer and for rho -> 0 these equations are the balance of a
// layer without inertia, with the same weights.
//
// A body behind either face that gives way, m dv/dt = its own force less the stress of the face, changes the trial stress
// of this face's vertex from t to t - (give - 1) s, give = 1 + G0 dt^2/(weight m). So the vertex returns a trial stress
// t/give with the stiffness G0/give: its equation is the one above with weight give in place of weight.

// The velocity that a stress causes, by a wave or by shearing the layer for one step, whichever is less  [m/(s Pa)].
inline double velocity_per_stress(const Material& soft, const Grid& grid, double dt) {
  return std::min(1.0 / std::sqrt(soft.density * soft.shear_modulus), grid.vertex.back() / (soft.shear_modulus * dt));
}

// Largest number of Newton steps of the search of one lane, and of evaluations of the balance in its guarded search.
inline constexpr int kWaveNewtonSteps = 60;
inline constexpr int kWaveEvaluations = 20'000;

struct WaveStep {
  const Material* soft;    // material of the soft body, where it does not depend on pressure
  const Grid* grid;        // grid of at most kMaxInertiaCells cells
  const double* response;  // response B: temperature rise of each vertex per unit heat flux at z = 0  [K m2/W]
  double dt;               // length of the step  [s]
  double heat_share;       // share of the friction heat that enters the heat equation: Problem::heat_partition
  alignas(64) double pressure[kLanes];  // normal pressure P  [Pa]
  alignas(64) double jump[kLanes];      // imposed velocity jump [V]  [m/s]
  alignas(64) double coulomb[kLanes];   // friction limit mu P; infinity: no friction limit  [Pa]
  // How the bodies at z = 0 and at z = h give way; 1: their velocities are imposed.
  alignas(64) double give_near[kLanes], give_far[kLanes];
  // Rows [vertex or cell][lane]: temperatures after the step without friction; the state before the step, and after it
  // in the lanes that are solved.
  const double* T_ad;
  double* strain;
  double* stress;
  double* velocity;
  const double* guess = nullptr;  // velocities from which Newton's method starts; null: those before the step
  bool tries_limit = false;       // whether the limit is tried before the stress without it, which may be far above
  bool forced = false;            // what the host changes in a step, a layer of little mass may follow by any amount
  bool heats_in_place = false;    // one of many steps that are solved for one answer, at given temperatures
  int most_steps = 6;             // Newton steps of the lanes together, after which each is searched alone
  int most_steps_alone = kWaveNewtonSteps;
};

struct WaveAnswer {
  alignas(64) double flux[kLanes];           // heat flux q into the layer  [W/m2]
  alignas(64) double slip_along[2][kLanes];  // flow and slip along stresses above 0, and along those below  [m]
  double interface_slip[kLanes];             // slip velocity v[-1] of the interface at z = 0, signed  [m/s]
  double evaluations[kLanes];                // of the balance: Newton steps and, alone, what shortens them
  std::uint32_t guarded;                     // lanes that needed the guarded search
};

// Solves all fields together and returns the lanes of `lanes` that have an answer; the rows of the others are as before.
// Lanes whose law of flow has a form for registers are first solved together by Newton's method; a lane that needs more
// steps is searched alone. If Newton's method with a line search does not converge there, a guarded search bisects the
// heat flux q and minimises the energy of the step at each q, which works from any start but may be long. A lane has no
// answer if this ends, after kWaveEvaluations of the balance at the latest, without balanced momentum.
std::uint32_t advance_waves(const WaveStep& step, std::uint32_t lanes, WaveAnswer& answer);

}  // namespace shearbus::physics
