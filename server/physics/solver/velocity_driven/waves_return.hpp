// The return of a trial stress to the yield stress of a vertex, DLP (42-48).
//
// The trial stress t = s_old + G0 dt dv/dz of a vertex, where dt is the length of the step, is returned to the yield stress:
// s = R(t). R is odd, and its slope lies in [0, 1]. For t > 0: s = t below the yield stress; above it
//   s + sqrt(3) G0 dep = t,   s = Y(ep + dep, dep/dt, P, T) / sqrt(3).
// For the law of Steinberg, Cochran and Guinan there is a kernel, in the unknown x = beta dep / (1 + beta ep):
//   s = min(strength (1 + x)^n, ceiling) g(P, T),   strength = Y0 (1 + beta ep)^n / sqrt(3),   ceiling = Y_max / sqrt(3).
// LawReturn returns by any law, in simple code.
#pragma once

#include "server/physics/material/material.hpp"
#include "server/physics/solver/velocity_driven/waves.hpp"

namespace shearbus::physics {

struct ReturnLaw {
  double exponent;  // hardening exponent n
  double ceiling;   // largest strength in shear  [Pa]
  double hT;        // coefficient of -(T - 300 K) in the bracket of the softening g  [1/K]
};
ReturnLaw return_law_of(const Material& soft);

// Inputs and results of the returns of one node, one value per vertex.
struct ReturnRows {
  using Row = WaveFields::Row;
  alignas(64) Row t;           // trial stress                                    [Pa]
  alignas(64) Row T;           // temperature                                     [K]
  alignas(64) Row strength;    // strength before softening  [Pa]
  alignas(64) Row compliance;  // growth of the hardening term x per stress, beta / (sqrt(3) G0 (1 + beta ep))  [1/Pa]
  alignas(64) Row x;           // hardening term, from which the next return starts; kUnknown: not known
  alignas(64) Row slope;       // derivative of the stress s by the trial stress t
  alignas(64) Row softening;   // derivative of the stress s by the temperature   [Pa/K]
};
inline constexpr double kUnknown = -1.0;

// `T_melt`: melting temperature at P  [K]; `bracket`: bracket of the softening g at T = 0 K: 1 + gP P + 300 hT.
void return_to_yield(const ReturnLaw& law, double T_melt, double bracket, int num_vertices, ReturnRows& rows,
                     double* stress);

struct ReturnedStress {
  double stress;     // magnitude s of the stress  [Pa]
  double slope;      // derivative of s by the trial stress
  double softening;  // derivative of s by the temperature at the trial stress  [Pa/K]
};

class LawReturn {
 public:
  // `dt`: length of the step, which gives the strain of a step its rate. `give`: factor by which the vertex is less stiff
  // (waves.hpp).
  LawReturn(const Material& soft, double pressure, double dt, double give = 1.0);

  // Solves s + sqrt(3) G0 dep = trial, s = Y(ep + dep, dep/dt, P, T)/sqrt(3), T = T_ad + rise s, with dep = 0 where s
  // would be above the trial stress. Y rises with dep, and T falls with it, so that there is one root.
  ReturnedStress at(double ep, double trial, double T_ad, double rise) const;

  // The strain dep in [0, most] at which the vertex carries a stress: the most of those at which it carries no more.
  double strain_under(double stress, double ep, double T, double most) const;

 private:
  double strength(double ep, double dep, double T) const;  // Y/sqrt(3)  [Pa]

  const Material& soft_;
  double pressure_, dt_, kappa_;
};

}  // namespace shearbus::physics
