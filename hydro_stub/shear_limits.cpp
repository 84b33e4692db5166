#include "hydro_stub/shear_limits.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace shearbus::hydro {
namespace {

constexpr double kPressureStep = 2e9;  // [Pa]
constexpr int kPressures = 16;

}  // namespace

double critical_jump(const physics::Material& soft, const physics::Material& hard, double pressure,
                     double start_temperature) {
  double jump = 0.0, last_strain = 0.0, tau = 0.0;
  physics::shear_adiabatically(soft, pressure, start_temperature, [&](double strain, double stress, double) {
    const double rise = stress / std::numbers::sqrt3 - tau;
    const double gamma = std::numbers::sqrt3 * (strain - last_strain) + rise / soft.shear_modulus;
    jump += std::sqrt(std::max(0.0, rise) * gamma / soft.density);
    tau += rise;
    last_strain = strain;
  });
  return jump + tau / std::sqrt(hard.density * hard.shear_modulus);
}

CriticalJump::CriticalJump(const physics::Material& soft, const physics::Material& hard, double start_temperature) {
  for (int i = 0; i < kPressures; ++i) jump_.push_back(critical_jump(soft, hard, i * kPressureStep, start_temperature));
}

double CriticalJump::at(double pressure) const {
  const double place = std::clamp(pressure / kPressureStep, 0.0, static_cast<double>(kPressures - 1));
  const std::size_t i = std::min<std::size_t>(static_cast<std::size_t>(place), kPressures - 2);
  const double share = place - static_cast<double>(i);
  return (1.0 - share) * jump_[i] + share * jump_[i + 1];
}

}  // namespace shearbus::hydro
