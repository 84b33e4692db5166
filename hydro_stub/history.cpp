#include "hydro_stub/history.hpp"

#include <numeric>
#include <vector>

namespace shearbus::hydro {
namespace {

enum Row : std::size_t {
  kShearStress,
  kSlidingVelocity,
  kInterfaceTemperature,
  kVelocityJumpNew,
  kRegime,
  kPressure,
  kStressMinus,
  kStressPlus,
  kVelocityJump,
};

// In the order of Row.
std::vector<wire::Quantity> rows() {
  return {
      {.name = "shear_stress", .units = "Pa", .long_name = "shear stress at the interface, during the step"},
      {.name = "sliding_velocity", .units = "m s-1", .long_name = "sliding velocity, mean of the step"},
      {.name = "interface_temperature",
       .units = "K",
       .long_name = "temperature of the interface at the end of the step"},
      {.name = "velocity_jump_new", .units = "m s-1", .long_name = "V_soft - V_hard at the end of the step"},
      {.name = "regime", .units = "1", .long_name = "what held the shear stress", .is_regime = true},
      {.name = "pressure", .units = "Pa", .long_name = "sent: pressure on the interface, compression positive"},
      {.name = "stress_minus", .units = "Pa", .long_name = "sent: shear stress in the soft zone at the interface"},
      {.name = "stress_plus", .units = "Pa", .long_name = "sent: shear stress in the hard zone at the interface"},
      {.name = "velocity_jump", .units = "m s-1", .long_name = "sent: V_soft - V_hard at the start of the step"},
  };
}

}  // namespace

std::vector<std::uint64_t> node_ids(std::size_t columns) {
  std::vector<std::uint64_t> ids(columns);
  std::iota(ids.begin(), ids.end(), std::uint64_t{0});
  return ids;
}

History::History(const std::filesystem::path& file, const Problem& problem, const ShearColumn& column,
                 const std::string& scene, const std::string& law)
    : writer_(
          file, node_ids(problem.columns), rows(),
          {{"producer", "shearbus-hydro"}, {"scene", scene}, {"scene_name", problem.name}, {"interface_law", law}}) {
  writer_.add_static(
      {.name = "mass_minus", .units = "kg m-2", .long_name = "sent: half the soft zone at the interface"},
      column.inputs().mass_soft);
  writer_.add_static({.name = "mass_plus", .units = "kg m-2", .long_name = "sent: half the hard zone at the interface"},
                     column.inputs().mass_hard);
  writer_.add_static({.name = "initial_temperature", .units = "K", .long_name = "of the interface at the start"},
                     problem.initial_temperature);
}

void History::record(const ShearColumn& column) {
  const InterfaceInputs& sent = column.inputs();
  const InterfaceAnswer& answer = column.answer();
  writer_.begin_row(sent.time, sent.dt);
  writer_.set(kShearStress, answer.shear_stress);
  writer_.set(kSlidingVelocity, answer.sliding_velocity);
  writer_.set(kInterfaceTemperature, answer.interface_temperature);
  writer_.set(kVelocityJumpNew, answer.velocity_jump_new);
  writer_.set(kRegime, answer.regime);
  writer_.set(kPressure, sent.pressure);
  writer_.set(kStressMinus, sent.stress_soft);
  writer_.set(kStressPlus, sent.stress_hard);
  writer_.set(kVelocityJump, sent.velocity_jump);
  writer_.end_row();
}

}  // namespace shearbus::hydro
