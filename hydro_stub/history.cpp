#include "hydro_stub/history.hpp"

#include <iterator>
#include <numeric>
#include <span>
#include <vector>

#include "hydro_stub/history_rows.hpp"
#include "hydro_stub/scene.hpp"
#include "proto/scene/scene.hpp"

namespace shearbus::hydro {
namespace {

using wire::Field;

constexpr LawColumn kColumns[] = {
    {Field::kShearStress, "shear stress at the interface, during the step", {}, &InterfaceAnswer::shear_stress},
    {Field::kSlidingVelocity, "sliding velocity, mean of the step", {}, &InterfaceAnswer::sliding_velocity},
    {Field::kInterfaceTemperature,
     "temperature of the interface at the end of the step",
     {},
     &InterfaceAnswer::interface_temperature},
    {Field::kVelocityJumpNew, "V_soft - V_hard at the end of the step", {}, &InterfaceAnswer::velocity_jump_new},
    {Field::kRegime, ""},
    {Field::kPressure, "sent: pressure on the interface, compression positive", &InterfaceInputs::pressure},
    {Field::kStressSoft, "sent: shear stress in the soft zone at the interface", &InterfaceInputs::stress_soft},
    {Field::kStressHard, "sent: shear stress in the hard zone at the interface", &InterfaceInputs::stress_hard},
    {Field::kVelocityJump, "sent: V_soft - V_hard at the start of the step", &InterfaceInputs::velocity_jump}};

// Behind kColumns, if the soft body yields; behind all, if the hard body's back is free: its velocity.
constexpr LawColumn kPlasticRate = {Field::kSoftPlasticStrainRate,
                                    "sent: plastic strain rate of the soft zone, with the sign of its shear",
                                    &InterfaceInputs::soft_plastic_strain_rate};

bool has_free_surface(const ShearBody& body) {
  return body.mesh.far_end == guest::FAR_END_FREE;
}

std::vector<files::Quantity> quantities_of(const ShearColumn& column) {
  std::vector<files::Quantity> quantities;
  for (const LawColumn& of_law : kColumns) quantities.push_back(of_law.quantity());
  if (column.bulk()) quantities.push_back(kPlasticRate.quantity());
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

std::map<std::string, std::string> meta_of(const guest::HydroScene& effective, const server::Entries& provenance) {
  std::map<std::string, std::string> meta = {{"producer", "shearbus-hydro " + server::value_of(provenance, "version")},
                                             {"scene", scene::to_toml(effective)},
                                             {"scene_name", effective.scene().name()},
                                             {"interface_law", name(effective.hydro().interface_law())}};
  for (const char* key : {"commit", "date", "machine", "command"}) meta.emplace(key, server::value_of(provenance, key));
  return meta;
}

History::History(const std::filesystem::path& file, const ColumnProblem& problem, const ShearColumn& column,
                 const std::map<std::string, std::string>& meta)
    : writer_(file, node_ids(problem.columns), quantities_of(column), meta) {
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
  std::size_t q = 0;
  const auto set = [&](const auto& values) { writer_.set(q++, values); };
  for (const LawColumn& of_law : kColumns) of_law.record(sent, answer, set);
  if (column.bulk()) kPlasticRate.record(sent, answer, set);
  if (const ShearBody& hard = column.hard(); has_free_surface(hard))
    set(std::span(hard.velocity_at(hard.mesh.zones), hard.mesh.columns));
  writer_.end_row();
}

}  // namespace shearbus::hydro
