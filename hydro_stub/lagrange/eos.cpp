#include "hydro_stub/lagrange/eos.hpp"

#include <algorithm>
#include <cmath>

#include "hydro_stub/lagrange/mesh.hpp"

namespace shearbus::lagrange {
namespace {

// Smallest value used for the denominator 1 - s1 n - s2 n^2 - s3 n^3 of the Hugoniot pressure, where n = 1 - rho0/rho
// is the compression. The denominator would be 0 at the largest compression that a shock can reach.
constexpr double kLeastDenominator = 0.05;

}  // namespace

EosPoint eos_from_density_energy(const MieGrueneisen& m, double density, double energy) {
  const double compression = 1.0 - m.density / density;
  const double modulus = m.density * m.sound_speed * m.sound_speed;
  const double thermal = m.gamma0 * m.density;
  double cold;   // pressure at zero energy  [Pa]
  double slope;  // derivative of `cold` by the compression  [Pa]
  if (compression > 0.0) {
    const double n = compression;
    const double d = std::max(kLeastDenominator, 1.0 - n * (m.s1 + n * (m.s2 + n * m.s3)));
    const double hugoniot = modulus * n / (d * d);
    const double hugoniot_slope = modulus * (d + 2.0 * n * (m.s1 + n * (2.0 * m.s2 + 3.0 * n * m.s3))) / (d * d * d);
    cold = hugoniot * (1.0 - 0.5 * m.gamma0 * n);
    slope = hugoniot_slope * (1.0 - 0.5 * m.gamma0 * n) - 0.5 * m.gamma0 * hugoniot;
  } else {
    cold = modulus * compression / (1.0 - compression);
    slope = modulus / ((1.0 - compression) * (1.0 - compression));
  }
  const double pressure = cold + thermal * energy;
  const double square = (m.density * slope + pressure * thermal) / (density * density);
  // The sound speed of a spalled or vaporised zone is at least a tenth of the reference value, so that the time step
  // stays bounded.
  const double least = 0.01 * m.sound_speed * m.sound_speed;
  return {std::max(pressure, -m.tension_limit), std::max(square, least)};
}

Eos::Eos(const IdealGas& gas) : is_gas_(true), gas_(gas) {}

Eos::Eos(const MieGrueneisen& metal) : is_gas_(false), metal_(metal) {
  tabulate_isentrope();
}

void Eos::evaluate(const std::vector<double>& density, const std::vector<double>& energy, int first, int last,
                   std::vector<double>& pressure, std::vector<double>& sound_speed_squared) const {
  const auto evaluate_with = [&](const auto& law) {
#pragma omp parallel for schedule(static) if (last - first >= kFewestForThreads)
    for (int z = first; z < last; ++z) {
      const EosPoint point = eos_from_density_energy(law, density[z], energy[z]);
      pressure[z] = point.pressure;
      sound_speed_squared[z] = point.sound_speed_squared;
    }
  };
  if (is_gas_) {
    evaluate_with(gas_);
  } else {
    evaluate_with(metal_);
  }
}

EosPoint Eos::at(double density, double energy) const {
  return is_gas_ ? eos_from_density_energy(gas_, density, energy) : eos_from_density_energy(metal_, density, energy);
}

double Eos::temperature(double density, double energy) const {
  if (is_gas_) return energy / gas_.specific_heat;
  const double compression = 1.0 - metal_.density / density;
  const double on_isentrope = metal_.reference_temperature * std::exp(metal_.gamma0 * compression);
  return on_isentrope + (energy - isentrope_energy(compression)) / metal_.specific_heat;
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

// Interpolates the energy on the isentrope by the cubic through tabulated values and slopes; beyond the table the
// energy is linear with the last slope.
double Eos::isentrope_energy(double compression) const {
  const double last = static_cast<double>(isentrope_energy_.size() - 1);
  const double at = (compression - first_compression_) / compression_step_;
  if (at <= 0.0) return isentrope_energy_.front() + at * compression_step_ * isentrope_slope_.front();
  if (at >= last) return isentrope_energy_.back() + (at - last) * compression_step_ * isentrope_slope_.back();
  const std::size_t i = static_cast<std::size_t>(at);
  const double t = at - static_cast<double>(i);
  const double u = 1.0 - t;
  return u * u * (1.0 + 2.0 * t) * isentrope_energy_[i] + t * t * (3.0 - 2.0 * t) * isentrope_energy_[i + 1] +
         compression_step_ * t * u * (u * isentrope_slope_[i] - t * isentrope_slope_[i + 1]);
}

}  // namespace shearbus::lagrange
