// The return of a trial stress to the yield stress of a vertex, DLP (42-48).
//
// The trial stress t = s_old + G0 dt dv/dz of a vertex, where dt is the length of the step, is returned to the yield stress:
// s = R(t). R is odd, and its slope lies in [0, 1]. For t > 0: s = t below the yield stress; above it
//   s + sqrt(3) G0 dep = t,   s = Y(ep + dep, dep/dt, P, T) / sqrt(3).
// LawReturn returns by any law, in simple code; waves_kernel.hpp by that of Steinberg, Cochran and Guinan.
#pragma once

#include "server/physics/material/material.hpp"

namespace shearbus::physics {

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
