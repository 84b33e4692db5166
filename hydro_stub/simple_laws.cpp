#include "hydro_stub/simple_laws.hpp"

#include <algorithm>
#include <cmath>

namespace shearbus::hydro {

wire::Batch InterfaceLaw::profiles(std::span<const std::uint64_t> /*node_ids*/, std::span<const double> /*pressure*/) {
  throw wire::Error({.code = wire::Code::kUnsupported,
                     .text = "this interface law has no layers, and so no profiles",
                     .remedy = "leave out [hydro.profiles]",
                     .field = "hydro.profiles"});
}
namespace {

// The laws of this file compute no interface temperature: they answer the temperature of the soft zone, or 300 K if the
// host gives no zone temperatures.
constexpr double kRoomTemperature = 300.0;

void answer_without_heat(const InterfaceInputs& inputs, std::size_t i, double stress, InterfaceAnswer& answer) {
  const FreeJump free = free_jump(inputs, i);
  answer.shear_stress[i] = stress;
  answer.velocity_jump_new[i] = free.jump - stress * free.compliance;
  answer.sliding_velocity[i] = 0.5 * (inputs.velocity_jump[i] + answer.velocity_jump_new[i]);
  answer.interface_temperature[i] = inputs.zone_temperature.empty() ? kRoomTemperature : inputs.zone_temperature[i];
  answer.friction_heat[i] = 0.0;
}

void set_regime(const InterfaceInputs& inputs, std::size_t i, wire::Regime closed, InterfaceAnswer& answer) {
  answer.regime[i] = static_cast<std::uint8_t>(inputs.pressure[i] > 0.0 ? closed : wire::Regime::kOpen);
}

}  // namespace

// Free slip is reported as Coulomb slip with a friction limit of 0.
void FreeSlipLaw::advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) {
  for (std::size_t i = 0; i < inputs.velocity_jump.size(); ++i) {
    answer_without_heat(inputs, i, 0.0, answer);
    set_regime(inputs, i, wire::Regime::kCoulomb, answer);
  }
}

void StickLaw::advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) {
  for (std::size_t i = 0; i < inputs.velocity_jump.size(); ++i) {
    const bool closed = inputs.pressure[i] > 0.0;
    const FreeJump free = free_jump(inputs, i);
    answer_without_heat(inputs, i, closed ? free.jump / free.compliance : 0.0, answer);
    if (closed) answer.velocity_jump_new[i] = 0.0;
    set_regime(inputs, i, wire::Regime::kStick, answer);
  }
}

void ConstantFrictionLaw::advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) {
  for (std::size_t i = 0; i < inputs.velocity_jump.size(); ++i) {
    const FreeJump free = free_jump(inputs, i);
    const double sticking = free.jump / free.compliance;
    const bool sticks = std::abs(sticking) <= limit_;
    answer_without_heat(inputs, i, sticks ? sticking : std::copysign(limit_, sticking), answer);
    if (sticks) answer.velocity_jump_new[i] = 0.0;
    answer.friction_heat[i] = std::max(0.0, answer.shear_stress[i] * answer.sliding_velocity[i] * inputs.dt);
    answer.regime[i] = static_cast<std::uint8_t>(sticks ? wire::Regime::kStick : wire::Regime::kTresca);
  }
}

}  // namespace shearbus::hydro
