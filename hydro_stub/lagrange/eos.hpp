// Equations of state: pressure, sound speed and temperature from density and specific internal energy.
#pragma once

#include <limits>
#include <vector>

namespace shearbus::lagrange {

struct EosPoint {
  double pressure;  // [Pa]
  // square of the sound speed: dP/drho at constant e plus (P/rho^2) dP/de at constant rho; never negative  [m2/s2]
  double sound_speed_squared;
};

struct IdealGas {
  double gamma = 5.0 / 3.0;
  double specific_heat = 1.0;  // specific heat at constant volume, for the temperature only  [J/(kg K)]
};

// Mie-Grueneisen equation of state. The reference is the Hugoniot Us = c0 + s1 up + s2 (up/Us) up + s3 (up/Us)^2 up of
// shock velocity Us and particle velocity up, and rho Gamma = rho0 gamma0 (D. J. Steinberg, LLNL UCRL-MA-106439,
// without its volume correction of Gamma). In tension P = c0^2 (rho - rho0) + gamma0 rho0 e. The specific internal
// energy e is 0 at the density rho0 and the reference temperature.
struct MieGrueneisen {
  double density = 0.0;      // rho0    [kg/m3]
  double sound_speed = 0.0;  // c0      [m/s]
  double s1 = 0.0;
  double s2 = 0.0;
  double s3 = 0.0;
  double gamma0 = 0.0;
  double specific_heat = 0.0;            // [J/(kg K)]
  double reference_temperature = 300.0;  // [K]
  // the metal spalls where the pressure would fall below -tension_limit: P >= -tension_limit  [Pa]
  double tension_limit = std::numeric_limits<double>::infinity();
};

inline EosPoint eos_from_density_energy(const IdealGas& gas, double density, double energy) {
  const double pressure = (gas.gamma - 1.0) * density * energy;
  return {pressure, gas.gamma * (gas.gamma - 1.0) * (energy > 0.0 ? energy : 0.0)};
}

EosPoint eos_from_density_energy(const MieGrueneisen& metal, double density, double energy);

// The equation of state of a material, with the tables that it needs.
class Eos {
 public:
  explicit Eos(const IdealGas& gas);
  explicit Eos(const MieGrueneisen& metal);

  // Computes pressure and squared sound speed of the zones [first, last).
  void evaluate(const std::vector<double>& density, const std::vector<double>& energy, int first, int last,
                std::vector<double>& pressure, std::vector<double>& sound_speed_squared) const;

  EosPoint at(double density, double energy) const;

  // Returns the temperature  [K]. For a gas T = e / c_v with the specific heat c_v. For a metal T = T_s(rho) + (e -
  // e_s(rho)) / c_v, where T_s(rho) = T_ref exp(gamma0 (1 - rho0/rho)) and e_s(rho) are temperature and energy on the
  // isentrope through the reference state (density rho0, temperature T_ref).
  double temperature(double density, double energy) const;

  // Returns half of dUs/dup, the slope of shock velocity Us over particle velocity up: (gamma + 1)/4 for a gas, s1/2
  // for a metal. It scales the quadratic part of the artificial viscosity.
  double half_shock_slope() const;

 private:
  void tabulate_isentrope();
  double isentrope_energy(double compression) const;

  bool is_gas_;
  IdealGas gas_;
  MieGrueneisen metal_;
  // Table of the energy and its slope on the isentrope through the reference state, at equal steps of the compression
  // 1 - rho0/rho.
  double first_compression_ = 0.0;
  double compression_step_ = 0.0;
  std::vector<double> isentrope_energy_;
  std::vector<double> isentrope_slope_;
};

}  // namespace shearbus::lagrange
