// Metal in shear that its own plastic work heats, without conduction.
#pragma once

#include <functional>

#include "server/physics/material/material.hpp"

namespace shearbus::physics {

// Shears the metal in small steps of the plastic strain until its flow stress falls. Calls each(strain, stress,
// temperature) with rising stresses [Pa]. Laws that depend on the rate are evaluated at 1e5/s.
void shear_adiabatically(const Material& metal, double pressure, double start_temperature,
                         const std::function<void(double, double, double)>& each);

// The largest flow stress that metal reaches in adiabatic shear, Y*. An interface whose yield strength is above Y* slips
// on coarse zones of a host's mesh only: on fine zones the metal beside it yields and shears in place of slip.
struct AdiabaticPeak {
  double stress;       // Y*  [Pa]
  double strain;       // equivalent plastic strain there
  double temperature;  // [K]
};
AdiabaticPeak adiabatic_peak(const Material& metal, double pressure, double start_temperature);

}  // namespace shearbus::physics
