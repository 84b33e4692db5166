// The melt film of a scene with [melt_film] (MODEL.md, "Melt film"): the laws of the liquid and of the solid contact.
#pragma once

#include <algorithm>

#include "server/physics/material/elementary.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/options.hpp"

namespace shearbus::physics {

inline constexpr double kGasConstant = 8.31446261815324;  // R  [J/(mol K)]

// Latent heat as the rise of temperature of the solid that it would cause: rho L / (k/alpha)  [K].
inline double latent_rise(const MeltFilmOptions& film, const Material& soft) {
  return soft.density * film.latent_heat * soft.diffusivity / soft.conductivity;
}

// 1 / eta(T) of the liquid. `soft`: the material at the pressure of the node, with its melting temperature. A vertex
// below melting counts as at melting  [1/(Pa s)].
inline double fluidity(const MeltFilmOptions& film, const Material& soft, double T) {
  const double excess = std::max(0.0, 1.0 / soft.melting_temperature - 1.0 / std::max(T, soft.melting_temperature));
  return exponential(film.activation_energy / kGasConstant * excess) / film.viscosity;
}

// Strength of the solid contact, DLP (65) with the softening of Steinberg, Cochran and Guinan as they print it: without
// the factor exp(-0.001 T/(T_melt - T)) of DLP (15), whose loss of strength the film stands for.
struct SolidContact {
  double coulomb;       // mu P  [Pa]
  double tresca;        // yield strength of the interface / sqrt(3)  [Pa]
  double bracket_at_0;  // 1 + gP P + 300 hT, so that the bracket of DLP (15) is bracket_at_0 - hT T
  double hT;            // [1/K]
  double T_melt;        // [K]

  SolidContact(double friction_coefficient, double strength, const Material& soft, double pressure)
      : coulomb(friction_coefficient * pressure),
        tresca(strength),
        bracket_at_0(SteinbergCochranGuinan::bracket_at(soft, pressure)),
        hT(soft.temperature_coefficient),
        T_melt(soft.melting_temperature) {}

  double yield(double T0) const { return tresca * std::max(0.0, bracket_at_0 - hT * std::min(T0, T_melt)); }
  double stress(double T0) const { return std::min(coulomb, yield(T0)); }
};

}  // namespace shearbus::physics
