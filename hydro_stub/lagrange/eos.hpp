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

// Without branches: loops over zones vectorise.
inline EosPoint eos_from_density_energy(const MieGrueneisen& m, double density, double energy) {
  // Smallest value used for the denominator 1 - s1 n - s2 n^2 - s3 n^3 of the Hugoniot pressure, where n = 1 - rho0/rho
  // is the compression. The denominator would be 0 at the largest compression that a shock can reach.
  constexpr double kLeastDenominator = 0.05;
  const double n = 1.0 - m.density / density;
  const double modulus = m.density * m.sound_speed * m.sound_speed;
  const double thermal = m.gamma0 * m.density;
  const double denominator = 1.0 - n * (m.s1 + n * (m.s2 + n * m.s3));
  const double d = denominator < kLeastDenominator ? kLeastDenominator : denominator;
  const double hugoniot = modulus * n / (d * d);
  const double hugoniot_slope = modulus * (d + 2.0 * n * (m.s1 + n * (2.0 * m.s2 + 3.0 * n * m.s3))) / (d * d * d);
  const double compressed = 1.0 - 0.5 * m.gamma0 * n;
  const bool in_compression = n > 0.0;
  // `cold`: pressure at zero energy [Pa]; `slope`: its derivative by the compression  [Pa]
  const double cold = in_compression ? hugoniot * compressed : modulus * n / (1.0 - n);
  const double slope =
      in_compression ? hugoniot_slope * compressed - 0.5 * m.gamma0 * hugoniot : modulus / ((1.0 - n) * (1.0 - n));
  const double pressure = cold + thermal * energy;
  const double square = (m.density * slope + pressure * thermal) / (density * density);
  // The sound speed of a spalled or vaporised zone is at least a tenth of the reference value, so that the time step
  // stays bounded.
  const double least = 0.01 * m.sound_speed * m.sound_speed;
  return {pressure < -m.tension_limit ? -m.tension_limit : pressure, square < least ? least : square};
}

// The equation of state of a material, with the tables that it needs.
class Eos {
 public:
  explicit Eos(const IdealGas& gas);
  explicit Eos(const MieGrueneisen& metal);

  // Computes pressure and squared sound speed of `count` zones.
  void evaluate(int count, const double* density, const double* energy, double* pressure,
                double* sound_speed_squared) const;

  // Computes the temperatures of `count` zones  [K]. For a gas T = e / c_v with the specific heat c_v. For a metal T = T_s(rho) + (e -
  // e_s(rho)) / c_v, where T_s(rho) = T_ref exp(gamma0 (1 - rho0/rho)) and e_s(rho) are temperature and energy on the
  // isentrope through the reference state (density rho0, temperature T_ref). In a zone at the tension limit rho and e are
  // those of the metal between the voids: a zone that stretches there under constant tension cools no further.
  void find_temperatures(int count, const double* density, const double* energy, double* temperature) const;

  // Returns half of dUs/dup, the slope of shock velocity Us over particle velocity up: (gamma + 1)/4 for a gas, s1/2
  // for a metal. It scales the quadratic part of the artificial viscosity.
  double half_shock_slope() const;

 private:
  void tabulate_isentrope();
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
