#include "hydro_stub/coulomb_tresca_law.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/physics/material/strength.hpp"

namespace shearbus::hydro {

CoulombTrescaLaw::CoulombTrescaLaw(const guest::CoulombTresca& constants, const physics::Material& soft,
                                   const physics::Material& hard, std::span<const double> initial_temperature)
    : friction_{.friction_coefficient = constants.friction_coefficient_at_rest(),
                .friction_law = physics::FrictionLaws::place<physics::VelocityWeakening>(),
                .friction_coefficient_fast = constants.friction_coefficient_fast(),
                .velocity_decay = constants.velocity_decay_s_per_m()},
      yield_fraction_(constants.yield_fraction()),
      soft_(soft),
      heat_share_(physics::heat_partition(soft, hard)),
      cell_temperature_(initial_temperature.begin(), initial_temperature.end()) {}

void CoulombTrescaLaw::advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) {
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < inputs.velocity_jump.size(); ++i) advance_node(inputs, i, answer);
  spent_ += std::chrono::steady_clock::now() - start;
}

// Solves the step of a node in magnitudes, along the direction in which the interface would slip without friction. The
// friction coefficient is that at the mean velocity jump of the step, as the friction power uses this mean. A node
// sticks if the stress that makes the jump at the end of the step 0 is within the limit; this jump is then set to
// exactly 0. The yield strength is that of the soft zone at the start of the step.
void CoulombTrescaLaw::advance_node(const InterfaceInputs& inputs, std::size_t i, InterfaceAnswer& answer) {
  const FreeJump free = free_jump(inputs, i);
  const double pressure = inputs.pressure[i];
  const double jump = inputs.velocity_jump[i];
  const double direction = std::copysign(1.0, free.jump);
  const bool host_heats = !inputs.zone_temperature.empty();
  if (host_heats) cell_temperature_[i] = inputs.zone_temperature[i];
  double& temperature = cell_temperature_[i];
  const double plastic_strain = inputs.zone_plastic_strain.empty() ? 0.0 : inputs.zone_plastic_strain[i];

  double stress = 0.0;
  wire::Regime regime = wire::Regime::kOpen;
  bool sticks = false;
  if (pressure > 0.0) {
    const double yield =
        yield_fraction_ * physics::flow_stress(soft_, plastic_strain, pressure, temperature) / std::numbers::sqrt3;
    const double sticking = std::abs(free.jump) / free.compliance;
    const double sliding = physics::sliding_stress(friction_, soft_, pressure, 0.5 * direction * (jump + free.jump),
                                                   0.5 * free.compliance);
    const bool was_sticking = jump == 0.0;
    const double limit = std::min(was_sticking ? friction_.friction_coefficient * pressure : sliding, yield);
    sticks = sticking <= limit;
    stress = sticks ? sticking : std::min(sliding, yield);
    regime = sticks             ? wire::Regime::kStick
             : sliding <= yield ? wire::Regime::kCoulomb
             : temperature >= physics::kMeltingShare * physics::at_pressure(soft_, pressure).melting_temperature
                 ? wire::Regime::kMelting
                 : wire::Regime::kTresca;
  }
  answer.shear_stress[i] = direction * stress;
  answer.velocity_jump_new[i] = sticks ? 0.0 : free.jump - answer.shear_stress[i] * free.compliance;
  answer.sliding_velocity[i] = 0.5 * (jump + answer.velocity_jump_new[i]);

  const double work = std::max(0.0, answer.shear_stress[i] * answer.sliding_velocity[i] * inputs.dt);
  const double zone_capacity = soft_.conductivity / soft_.diffusivity * 2.0 * inputs.mass_soft[i] / soft_.density;
  answer.friction_heat[i] = heat_share_ * work;
  if (!host_heats) temperature += answer.friction_heat[i] / zone_capacity;
  answer.interface_temperature[i] = temperature;
  answer.regime[i] = static_cast<std::uint8_t>(regime);
}

}  // namespace shearbus::hydro
