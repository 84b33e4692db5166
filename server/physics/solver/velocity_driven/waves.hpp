// Shear waves in the layer of one node (MODEL.md, "Layer inertia"): DLP (36-37) with inertia, (42-48) at every vertex.
#pragma once

#include <algorithm>
#include <cmath>

#include "server/physics/layer/grid.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/model.hpp"

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

struct WaveStep {
  const Material* soft;    // material of the soft body, with its properties at the pressure of the node
  const Grid* grid;        // grid of at most kMaxInertiaCells cells
  const double* response;  // response B: temperature rise of each vertex per unit heat flux at z = 0  [K m2/W]
  double dt;               // length of the step                           [s]
  double pressure;         // normal pressure P                            [Pa]
  double jump;             // imposed velocity jump [V]                    [m/s]
  double heat_share;       // share of the friction heat that enters the heat equation: Problem::heat_partition
  double coulomb;          // friction limit mu P; infinity: no friction limit         [Pa]
  double give_near = 1.0;  // how the bodies at z = 0 and at z = h give way; 1: their velocities are imposed
  double give_far = 1.0;
  bool forced = false;  // what the host changes in a step, a layer of little mass may follow by any amount
};

// The velocity that a stress causes, by a wave or by shearing the layer for one step, whichever is less  [m/(s Pa)].
inline double velocity_per_stress(const Material& soft, const Grid& grid, double dt) {
  return std::min(1.0 / std::sqrt(soft.density * soft.shear_modulus), grid.vertex.back() / (soft.shear_modulus * dt));
}

// The fields of one node, with a value per cell for the velocity and per vertex for the others.
struct WaveFields {
  static constexpr int kPacket = 8;  // vertices per SIMD packet; the length of a Row is a multiple of this number
  using Row = double[(kMaxInertiaCells / kPacket + 1) * kPacket];
  alignas(64) Row T_ad;           // temperature after the step without friction  [K]
  alignas(64) Row strain;         // plastic strain ep before the step
  alignas(64) Row stress;         // stress s: before the step on entry, after the step on return  [Pa]
  alignas(64) Row velocity;       // velocity v: before the step on entry, after the step on return  [m/s]
  alignas(64) Row strain_growth;  // growth of the plastic strain in the step, dep
  alignas(64) Row guess;          // velocities from which the search starts, if has_guess
  bool has_guess = false;         // else it starts from those before the step
};

struct WaveAnswer {
  double flux = 0.0;            // heat flux q into the layer             [W/m2]
  double interface_slip = 0.0;  // slip velocity v[-1] of the interface at z = 0, signed  [m/s]
  int iterations = 0;           // number of Newton steps
  bool guarded = false;         // true: Newton's method did not converge, and the guarded search (bisection of q) ran
  bool found = true;            // false: the guarded search ended without balance, and the fields are meaningless
};

// Solves all fields together by Newton's method. If it has not converged after `newton_steps`, a guarded search
// follows. It bisects the heat flux q and minimises the energy of the step at each q, which works from any start
// but may be long. `found` is false if it ends, after `evaluations` of the balance at the latest, without balanced
// momentum.
inline constexpr int kWaveNewtonSteps = 60;
inline constexpr int kWaveEvaluations = 200'000;
WaveAnswer advance_waves(const WaveStep& step, WaveFields& fields, int newton_steps = kWaveNewtonSteps,
                         int evaluations = kWaveEvaluations);

}  // namespace shearbus::physics
