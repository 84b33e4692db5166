// Advances stress deviators: hypo-elastic, rotated with the metal, returned radially to the flow stress.
#pragma once

#include <cmath>

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
inline double equivalent_stress(const Deviator& s) {
  const double zz = s.xx + s.yy;
  return std::sqrt(1.5 * (s.xx * s.xx + s.yy * s.yy + zz * zz + 2.0 * s.xy * s.xy));
}

struct StrengthStep {
  Deviator deviator;
  double plastic_strain_increment = 0.0;
};

// Some zones of one metal, side by side, so that the compiler vectorises the arithmetic. No zone enters the arithmetic
// of another one.
struct Strip {
  static constexpr int kMostZones = Run::kMostZones;
  int zones = 0;
  // before a step
  double plastic_strain[kMostZones];
  double pressure[kMostZones];                                                                // [Pa]
  double temperature[kMostZones];                                                             // [K]
  double strain_rate_xx[kMostZones], strain_rate_yy[kMostZones], strain_rate_xy[kMostZones];  // deviatoric  [1/s]
  double spin[kMostZones];                                                                    // [1/s]
  // before and after a step
  double xx[kMostZones], yy[kMostZones], xy[kMostZones];  // stress deviator  [Pa]
  // after a step
  double increment[kMostZones];  // of the equivalent plastic strain

  void add(const Deviator& s, const Gradient& d, double strain, double P, double T) {
    const double mean = d.dilatation() / 3.0;
    xx[zones] = s.xx;
    yy[zones] = s.yy;
    xy[zones] = s.xy;
    strain_rate_xx[zones] = d.xx - mean;
    strain_rate_yy[zones] = d.yy - mean;
    strain_rate_xy[zones] = 0.5 * (d.xy + d.yx);
    spin[zones] = 0.5 * (d.yx - d.xy);
    plastic_strain[zones] = strain;
    pressure[zones] = P;
    temperature[zones++] = T;
  }
  StrengthStep step(int i) const { return {{xx[i], yy[i], xy[i]}, increment[i]}; }
};

// Advances the deviators of an elastic-plastic metal with shear modulus G0 (constant, as in the shear layer) by dt:
//   1. rotation by the exact angle of the mid-step spin (Hughes & Winget, Int. J. Numer. Meth. Eng. 15 (1980) 1862):
//      a rigid rotation of any size leaves the invariants unchanged
//   2. elastic trial: the deviator of the stress grows by 2 G0 dt times the deviator of the strain rate
//   3. radial return (Wilkins, Methods Comput. Phys. 3 (1964) 211) to the flow stress at the plastic strain after
//      the step, which makes the hardening implicit
void advance_deviators(const physics::Material& metal, double dt, Strip& strip);

// The state of all zones before a step, as a strip takes it.
struct StrengthState {
  const Gradients& gradient;
  const double* plastic_strain;
  const double* pressure;
  const double* temperature;
  const double* xx;
  const double* yy;
  const double* xy;
};
// Makes a strip of the zones of a run.
void load(const StrengthState& state, const Run& run, Strip& strip);

}  // namespace shearbus::lagrange
