#include "hydro_stub/lagrange/eos.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "hydro_stub/lagrange/independent.hpp"
#include "server/physics/material/elementary.hpp"

namespace shearbus::lagrange {
namespace {

template <class Law>
SHEARBUS_WIDE void evaluate_wide(const Law& given, int count, const double* density, const double* energy,
                                 double* __restrict pressure, double* __restrict sound_speed_squared) {
  const Law law = given;  // a copy, which no store to the arrays can change
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < count; ++i) {
    const EosPoint point = eos_from_density_energy(law, density[i], energy[i]);
    pressure[i] = point.pressure;
    sound_speed_squared[i] = point.sound_speed_squared;
  }
}

// A table at equal steps of the compression 1 - rho0/rho.
struct Table {
  double first, step;
  int last;
  const double* energy;
  const double* slope;
};

// Interpolates the energy on the isentrope by the cubic through tabulated values and slopes; beyond the table the
// energy is linear with the last slope.
inline double isentrope_energy(const Table& table, double compression) {
  const double at = (compression - table.first) / table.step;
  const double last = table.last;
  const double above = at > 0.0 ? at : 0.0;
  const double inside = above < last ? above : last;
  const int place = static_cast<int>(inside);
  const int i = place < table.last ? place : table.last - 1;
  const double t = inside - i;
  const double u = 1.0 - t;
  const double energy = table.energy[i], energy_next = table.energy[i + 1];
  const double slope = table.slope[i], slope_next = table.slope[i + 1];
  const double end_slope = at > 0.0 ? slope_next : slope;
  return u * u * (1.0 + 2.0 * t) * energy + t * t * (3.0 - 2.0 * t) * energy_next +
         table.step * t * u * (u * slope - t * slope_next) + (at - inside) * table.step * end_slope;
}

struct Metal {
  double density;
  double energy;
};

// The metal between the voids of a torn zone: density rho_m and energy e_m at which the pressure without limit would be
// -tension_limit, with e_m = e - tension_limit (1/rho - 1/rho_m), because the zone grew from there under that tension. A
// zone above the tension limit is its own metal. Without branches: loops over zones vectorise.
inline Metal metal_between_voids(const MieGrueneisen& m, double density, double energy) {
  const double stiffness = m.sound_speed * m.sound_speed;
  const double thermal = m.gamma0 * m.density;
  const bool tears = m.tension_limit < std::numeric_limits<double>::infinity();
  const double limit = tears ? m.tension_limit : 0.0;
  // stiffness rho_m^2 + linear rho_m + thermal limit = 0
  const double linear = thermal * (energy - limit / density) - stiffness * m.density + limit;
  const double square = linear * linear - 4.0 * stiffness * thermal * limit;
  const double found = (std::sqrt(square > 0.0 ? square : 0.0) - linear) / (2.0 * stiffness);
  const double pressure = stiffness * (density - m.density) + thermal * energy;
  const bool torn = tears & (density < m.density) & (pressure < -limit);
  const double metal = torn ? found : density;
  return {metal, torn ? energy - limit * (1.0 / density - 1.0 / metal) : energy};
}

SHEARBUS_WIDE void find_temperatures_of_metal(const MieGrueneisen& given, const Table& of, int count,
                                              const double* density, const double* energy,
                                              double* __restrict temperature) {
  const MieGrueneisen m = given;
  const Table table = of;
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < count; ++i) {
    const Metal metal = metal_between_voids(m, density[i], energy[i]);
    const double compression = 1.0 - m.density / metal.density;
    const double on_isentrope = m.reference_temperature * physics::exponential(m.gamma0 * compression);
    temperature[i] = on_isentrope + (metal.energy - isentrope_energy(table, compression)) / m.specific_heat;
  }
}

}  // namespace

Eos::Eos(const IdealGas& gas) : is_gas_(true), gas_(gas) {}

Eos::Eos(const MieGrueneisen& metal) : is_gas_(false), metal_(metal) {
  tabulate_isentrope();
}

void Eos::evaluate(int count, const double* density, const double* energy, double* pressure,
                   double* sound_speed_squared) const {
  if (is_gas_) return evaluate_wide(gas_, count, density, energy, pressure, sound_speed_squared);
  evaluate_wide(metal_, count, density, energy, pressure, sound_speed_squared);
}

void Eos::find_temperatures(int count, const double* density, const double* energy, double* temperature) const {
  if (is_gas_) {
    for (int i = 0; i < count; ++i) temperature[i] = energy[i] / gas_.specific_heat;
    return;
  }
  const Table table = {.first = first_compression_,
                       .step = compression_step_,
                       .last = static_cast<int>(isentrope_energy_.size()) - 1,
                       .energy = isentrope_energy_.data(),
                       .slope = isentrope_slope_.data()};
  find_temperatures_of_metal(metal_, table, count, density, energy, temperature);
}

double Eos::half_shock_slope() const {
  return is_gas_ ? 0.25 * (gas_.gamma + 1.0) : 0.5 * metal_.s1;
}

// Integrates de = -P dV, that is de/d(compression) = P/rho0, by the classical Runge-Kutta method from the reference
// state into compression and into expansion.
void Eos::tabulate_isentrope() {
  constexpr int kHalf = 1000;
  constexpr double kFurthest = 0.5;
  MieGrueneisen metal = metal_;
  metal.tension_limit = std::numeric_limits<double>::infinity();
  const auto slope = [&](double compression, double energy) {
    return eos_from_density_energy(metal, metal.density / (1.0 - compression), energy).pressure / metal.density;
  };
  first_compression_ = -kFurthest;
  compression_step_ = kFurthest / kHalf;
  isentrope_energy_.assign(2 * kHalf + 1, 0.0);
  isentrope_slope_.assign(2 * kHalf + 1, 0.0);
  for (const int direction : {1, -1}) {
    const double h = direction * compression_step_;
    double energy = 0.0;
    for (int i = 0; i < kHalf; ++i) {
      const double n = i * h;
      const double k1 = slope(n, energy);
      const double k2 = slope(n + 0.5 * h, energy + 0.5 * h * k1);
      const double k3 = slope(n + 0.5 * h, energy + 0.5 * h * k2);
      const double k4 = slope(n + h, energy + h * k3);
      energy += h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4);
      const int place = kHalf + direction * (i + 1);
      isentrope_energy_[place] = energy;
      isentrope_slope_[place] = slope(n + h, energy);
    }
  }
}

}  // namespace shearbus::lagrange
