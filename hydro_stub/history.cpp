#include "hydro_stub/history.hpp"

#include <numeric>
#include <span>
#include <vector>

namespace shearbus::hydro {
namespace {

using wire::Field;

enum Row : std::size_t {
  kShearStress,
  kSlidingVelocity,
  kInterfaceTemperature,
  kVelocityJumpNew,
  kRegime,
  kPressure,
  kStressSoft,
  kStressHard,
  kVelocityJump,
  kFreeSurface,  // only of a hard body with a free back
};

bool has_free_surface(const ShearBody& body) {
  return body.mesh.far_end == guest::FAR_END_FREE;
}

// The quantities that history.h5 records, in the order of the enum Row.
std::vector<files::Quantity> rows(const ShearColumn& column) {
  std::vector<files::Quantity> quantities = {
      files::quantity_of_column(Field::kShearStress, 0, "shear stress at the interface, during the step"),
      files::quantity_of_column(Field::kSlidingVelocity, 0, "sliding velocity, mean of the step"),
      files::quantity_of_column(Field::kInterfaceTemperature, 0, "temperature of the interface at the end of the step"),
      files::quantity_of_column(Field::kVelocityJumpNew, 0, "V_soft - V_hard at the end of the step"),
      files::quantity_of_column(Field::kRegime),
      files::quantity_of_column(Field::kPressure, 0, "sent: pressure on the interface, compression positive"),
      files::quantity_of_column(Field::kStressSoft, 0, "sent: shear stress in the soft zone at the interface"),
      files::quantity_of_column(Field::kStressHard, 0, "sent: shear stress in the hard zone at the interface"),
      files::quantity_of_column(Field::kVelocityJump, 0, "sent: V_soft - V_hard at the start of the step"),
  };
  if (has_free_surface(column.hard()))
    quantities.push_back({.name = "free_surface_velocity",
                          .units = "m s-1",
                          .long_name = "of the hard body's free back, along the interface, at the end of the step"});
  return quantities;
}

}  // namespace

std::vector<std::uint64_t> node_ids(std::size_t columns) {
  std::vector<std::uint64_t> ids(columns);
  std::iota(ids.begin(), ids.end(), std::uint64_t{0});
  return ids;
}

std::map<std::string, std::string> History::origin(const server::Entries& provenance) {
  std::map<std::string, std::string> meta = {{"producer", "shearbus-hydro " + server::value_of(provenance, "version")}};
  for (const char* key : {"commit", "machine", "command"}) meta.emplace(key, server::value_of(provenance, key));
  return meta;
}

History::History(const std::filesystem::path& file, const ColumnProblem& problem, const ShearColumn& column,
                 const std::string& scene, const std::string& law, const server::Entries& provenance)
    : writer_(file, node_ids(problem.columns), rows(column), [&] {
        std::map<std::string, std::string> meta = origin(provenance);
        meta.insert({{"scene", scene}, {"scene_name", problem.name}, {"interface_law", law}});
        return meta;
      }()) {
  writer_.add_static(files::quantity_of_column(Field::kMassSoft, 0, "sent: half the soft zone at the interface"),
                     column.inputs().mass_soft);
  writer_.add_static(files::quantity_of_column(Field::kMassHard, 0, "sent: half the hard zone at the interface"),
                     column.inputs().mass_hard);
  writer_.add_static(files::quantity_of_column(Field::kInitialTemperature, 0, "of the interface at the start"),
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
  writer_.set(kStressSoft, sent.stress_soft);
  writer_.set(kStressHard, sent.stress_hard);
  writer_.set(kVelocityJump, sent.velocity_jump);
  if (const ShearBody& hard = column.hard(); has_free_surface(hard))
    writer_.set(kFreeSurface, std::span(hard.velocity_at(hard.mesh.zones), hard.mesh.columns));
  writer_.end_row();
}

}  // namespace shearbus::hydro
