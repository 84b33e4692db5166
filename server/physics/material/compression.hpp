// How a material changes with compression: its melting temperature and the pressure term of its softening at a pressure.
// Everything here is inlined into loops over lanes and vectorises. strength.hpp has the equations.
#pragma once

#include <cmath>

#include "server/physics/material/elementary.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics::compression {

// The compression eta = rho / rho0 on the principal Hugoniot. Solves P (1 - s x)^2 = rho0 c0^2 x for x = 1 - 1/eta: the
// root below 1/s, written without a difference, so that nothing cancels.
inline double eta_at(const Material& m, double pressure) {
  const double P = pressure > 0.0 ? pressure : 0.0;
  const double stiffness = m.density * m.sound_speed * m.sound_speed;
  const double slope = m.hugoniot_slope * P;
  const double x = 2.0 * P / (stiffness + 2.0 * slope + std::sqrt(stiffness * (stiffness + 4.0 * slope)));
  return 1.0 / (1.0 - x);
}

inline double lindemann_temperature(const Material& m, double eta) {
  return m.melting_temperature * (exponential(2.0 * m.volume_correction * (1.0 - 1.0 / eta)) *
                                  power(eta, 2.0 * (m.grueneisen - m.volume_correction - 1.0 / 3.0)));
}
inline double simon_temperature(const Material& m, double pressure) {
  const double P = pressure > 0.0 ? pressure : 0.0;
  return m.simon_temperature * power(1.0 + P / m.simon_pressure, 1.0 / m.simon_exponent);
}
inline double compressed_pressure_coefficient(const Material& m, double eta) {
  return m.pressure_coefficient * power(eta, -1.0 / 3.0);
}

}  // namespace shearbus::physics::compression
