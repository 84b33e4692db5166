// Advances stress deviators: hypo-elastic, rotated with the metal, returned radially to the flow stress.
#pragma once

#include "hydro_stub/lagrange/geometry.hpp"
#include "server/physics/material/strength.hpp"

namespace shearbus::lagrange {

// Components of a stress deviator in the plane; the component across the plane (hoop, or out of plane) is -(xx + yy).
struct Deviator {
  double xx = 0.0;
  double yy = 0.0;
  double xy = 0.0;
};

// Returns von Mises' equivalent stress sqrt(3/2 s:s).
double equivalent_stress(const Deviator& s);

struct StrengthStep {
  Deviator deviator;
  double plastic_strain_increment = 0.0;
};

// Advances the deviator of an elastic-plastic metal with shear modulus G0 (constant, as in the shear layer) by dt:
//   1. rotation by the exact angle of the mid-step spin (Hughes & Winget, Int. J. Numer. Meth. Eng. 15 (1980) 1862):
//      a rigid rotation of any size leaves the invariants unchanged
//   2. elastic trial: the deviator of the stress grows by 2 G0 dt times the deviator of the strain rate
//   3. radial return (Wilkins, Methods Comput. Phys. 3 (1964) 211) to the flow stress at the plastic strain after
//      the step, which makes the hardening implicit
StrengthStep advance_deviator(const physics::Material& metal, const Deviator& old, const Gradient& gradient, double dt,
                              double plastic_strain, double pressure, double temperature);

}  // namespace shearbus::lagrange
