#include "hydro_stub/shear_limits.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/physics/material/strength.hpp"

namespace shearbus::hydro {
namespace {

// Rate of shear at which laws that depend on the rate are evaluated, of the order of that in a zone of 0.1 mm  [1/s].
constexpr double kRate = 1e5;
constexpr double kStrainStep = 1e-3;
constexpr int kMostSteps = 20'000;
constexpr double kPressureStep = 2e9;  // [Pa]
constexpr int kPressures = 16;

// Shears the metal without conduction, in steps of the plastic strain, until its flow stress falls. Calls
// each(strain, stress, temperature) with rising stresses.
template <class Each>
void shear(const physics::Material& given, double pressure, double start_temperature, const Each& each) {
  const physics::Material metal = physics::at_pressure(given, pressure);
  const double capacity = metal.conductivity / metal.diffusivity;  // [J/(m3 K)]
  double temperature = start_temperature;
  double stress = physics::flow_stress(given, 0.0, pressure, temperature, kRate);
  each(0.0, stress, temperature);
  for (int i = 1; i <= kMostSteps; ++i) {
    const double strain = i * kStrainStep;
    // the heat of the step by the trapezoidal rule, with the stress at its end predicted from its start
    const double warmer = temperature + stress * kStrainStep / capacity;
    const double next = physics::flow_stress(given, strain, pressure, warmer, kRate);
    temperature += 0.5 * (stress + next) * kStrainStep / capacity;
    const double corrected = physics::flow_stress(given, strain, pressure, temperature, kRate);
    if (!(corrected > stress)) return;
    stress = corrected;
    each(strain, stress, temperature);
  }
}

}  // namespace

AdiabaticPeak adiabatic_peak(const physics::Material& metal, double pressure, double start_temperature) {
  AdiabaticPeak peak{};
  shear(metal, pressure, start_temperature, [&](double strain, double stress, double temperature) {
    peak = {.stress = stress, .strain = strain, .temperature = temperature};
  });
  return peak;
}

double critical_jump(const physics::Material& soft, const physics::Material& hard, double pressure,
                     double start_temperature) {
  double jump = 0.0, last_strain = 0.0, tau = 0.0;
  shear(soft, pressure, start_temperature, [&](double strain, double stress, double) {
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
