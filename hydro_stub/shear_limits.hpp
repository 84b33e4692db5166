// The largest sudden jump of velocities that the soft metal takes up in plastic waves. With Y*
// (server/physics/material/adiabatic_shear.hpp) it decides where a jump goes: into slip of the interface, into shear of
// the metal beside it, or into one zone of the mesh.
#pragma once

#include <vector>

#include "server/physics/material/adiabatic_shear.hpp"

namespace shearbus::hydro {

// The largest sudden jump of velocities that plastic waves take up,
//     V_crit = integral of sqrt(tau'/rho) dgamma + tau*/Z_hard,
// over the rising part of the stress tau(gamma) of adiabatic shear, from 0 to its largest value tau* = Y*/sqrt(3). rho
// is the soft metal's density and Z_hard the shear impedance of the hard body. A larger jump shears one zone of any mesh.
double critical_jump(const physics::Material& soft, const physics::Material& hard, double pressure,
                     double start_temperature);

// critical_jump() at any pressure, from a table.
class CriticalJump {
 public:
  CriticalJump(const physics::Material& soft, const physics::Material& hard, double start_temperature);
  double at(double pressure) const;  // [m/s]

 private:
  std::vector<double> jump_;  // at equal steps of the pressure
};

}  // namespace shearbus::hydro
