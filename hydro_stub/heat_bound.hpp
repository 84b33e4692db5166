// The most work that friction can do on an interface that stays below melting, per area (server/physics/MODEL.md, "What
// friction can do below melting"): 2 e (T_melt - T_start) sqrt(t/pi), t the time since friction began.
#pragma once

#include <cmath>
#include <numbers>

#include "server/physics/material/strength.hpp"

namespace shearbus::hydro {

struct HeatBound {
  physics::Material soft, hard;
  double start_temperature = 300.0;  // [K]

  double melting_temperature(double pressure) const { return physics::at_pressure(soft, pressure).melting_temperature; }
  // Returns the bound  [J/m2]. `melting`: highest melting temperature so far  [K].
  double work(double melting, double time) const {
    const double effusivity =
        soft.conductivity / std::sqrt(soft.diffusivity) + hard.conductivity / std::sqrt(hard.diffusivity);
    return 2.0 * effusivity * (melting - start_temperature) * std::sqrt(time * std::numbers::inv_pi);
  }
};

}  // namespace shearbus::hydro
