#include "server/physics/material/adiabatic_shear.hpp"

#include "server/physics/material/strength.hpp"

namespace shearbus::physics {
namespace {

// Rate of shear at which laws that depend on the rate are evaluated, of the order of that in a zone of 0.1 mm  [1/s].
constexpr double kRate = 1e5;
constexpr double kStrainStep = 1e-3;
constexpr int kMostSteps = 20'000;

}  // namespace

void shear_adiabatically(const Material& metal, double pressure, double start_temperature,
                         const std::function<void(double, double, double)>& each) {
  const Material pressed = at_pressure(metal, pressure);
  const double capacity = pressed.conductivity / pressed.diffusivity;  // [J/(m3 K)]
  double temperature = start_temperature;
  double stress = flow_stress(metal, 0.0, pressure, temperature, kRate);
  each(0.0, stress, temperature);
  for (int i = 1; i <= kMostSteps; ++i) {
    const double strain = i * kStrainStep;
    // the heat of the step by the trapezoidal rule, with the stress at its end predicted from its start
    const double warmer = temperature + stress * kStrainStep / capacity;
    const double next = flow_stress(metal, strain, pressure, warmer, kRate);
    temperature += 0.5 * (stress + next) * kStrainStep / capacity;
    const double corrected = flow_stress(metal, strain, pressure, temperature, kRate);
    if (!(corrected > stress)) return;
    stress = corrected;
    each(strain, stress, temperature);
  }
}

AdiabaticPeak adiabatic_peak(const Material& metal, double pressure, double start_temperature) {
  AdiabaticPeak peak{};
  shear_adiabatically(metal, pressure, start_temperature, [&](double strain, double stress, double temperature) {
    peak = {.stress = stress, .strain = strain, .temperature = temperature};
  });
  return peak;
}

}  // namespace shearbus::physics
