#include "client/replay/history_input.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace shearbus::replay {

HistoryInput::HistoryInput(wire::HistoryReader& history, const Scene& scene, bool closed_loop)
    : history_(history), force_driven_(scene.strategy == wire::Strategy::kForceDriven) {
  if (closed_loop && !force_driven_)
    throw Error(
        {.code = Code::kInvalidValue,
         .text = fmt::format("a closed loop needs strategy force_driven; scene \"{}\" has velocity_driven", scene.name),
         .remedy = "Leave --closed-loop out: the history imposes the jump."});
  need(Field::kPressure, "pressure");
  if (force_driven_) {
    need(Field::kStressMinus, "stress_minus");
    need(Field::kStressPlus, "stress_plus");
    for (const Column& mass : {Column{Field::kMassMinus, "mass_minus"}, Column{Field::kMassPlus, "mass_plus"}})
      history_.has(mass.dataset) ? fixed_.push_back(mass) : missing_.push_back(fmt::format("/{} [N]", mass.dataset));
    choose_jump(closed_loop);
    take(Field::kSoftPlasticStrainRate, "soft_plastic_strain_rate", scene.interface && scene.interface->plastic_layer,
         "without interface.plastic_layer there is no plastic strain to set against it");
  } else {
    need(Field::kVelocityJump, "velocity_jump");
    jump_origin_ = "imposed by /velocity_jump";
    take(Field::kSoftShearRate, "soft_shear_rate", scene.velocity_driven.drive == wire::Drive::kInterfaceSlip,
         "drive layer_shear takes the jump instead");
  }
  refuse_what_is_missing(scene);
  if (history_.has("initial_temperature")) initial_temperature_ = history_.per_node("initial_temperature");
}

void HistoryInput::need(Field field, const char* dataset) {
  if (history_.has(dataset))
    rows_.push_back({field, dataset});
  else
    missing_.push_back(fmt::format("/{} [T,N]", dataset));
}

void HistoryInput::take(Field field, const char* dataset, bool wanted, const char* why_not) {
  if (!history_.has(dataset)) return;
  if (!wanted) {
    notes_.push_back(fmt::format("/{} is not used: {}", dataset, why_not));
    return;
  }
  need(field, dataset);
  optional_columns_.push_back(field);
}

void HistoryInput::choose_jump(bool closed_loop) {
  const bool recorded = history_.has("velocity_jump");
  const bool initial = history_.has("initial_velocity_jump");
  if (!recorded && !initial) {
    missing_.emplace_back("/velocity_jump [T,N] (as recorded) or /initial_velocity_jump [N] (closed loop)");
    return;
  }
  closed_loop_ = closed_loop || !recorded;
  if (!closed_loop_) {
    need(Field::kVelocityJump, "velocity_jump");
    jump_origin_ = "as recorded in /velocity_jump";
    if (initial)
      notes_.emplace_back("/initial_velocity_jump is not used: /velocity_jump is there; --closed-loop would use it");
    return;
  }
  if (initial) {
    first_jump_ = history_.per_node("initial_velocity_jump");
    jump_origin_ = "closed loop from /initial_velocity_jump";
  } else {
    first_jump_.resize(history_.nodes());
    history_.row("velocity_jump", 0, first_jump_);
    jump_origin_ = "closed loop from the first row of /velocity_jump";
  }
}

void HistoryInput::refuse_what_is_missing(const Scene& scene) const {
  if (missing_.empty()) return;
  const char* const other = force_driven_ ? "velocity_driven" : "force_driven";
  const bool looks_like_the_other = force_driven_ ? history_.has("velocity_jump") && !history_.has("stress_minus")
                                                  : history_.has("stress_minus") && history_.has("mass_minus");
  throw Error(
      {.code = Code::kInvalidValue,
       .text = fmt::format("the history does not fit scene \"{}\": strategy {} needs {}, which it lacks", scene.name,
                           force_driven_ ? "force_driven" : "velocity_driven", fmt::join(missing_, ", ")),
       .remedy = looks_like_the_other ? fmt::format("It looks like one for strategy {}.", other)
                                      : "See client/replay/README.md for what a history holds.",
       .field = "strategy"});
}

void HistoryInput::prepare(Batch& request) const {
  for (const Column& column : fixed_)
    std::ranges::copy(history_.per_node(column.dataset), request.f64(column.field).begin());
  if (closed_loop_) std::ranges::copy(first_jump_, request.f64(Field::kVelocityJump).begin());
}

void HistoryInput::fill(std::size_t step, Batch& request) {
  for (const Column& column : rows_) history_.row(column.dataset, step, request.f64(column.field));
}

void HistoryInput::feed_back(const StepResult& result, Batch& request) const {
  if (closed_loop_) std::ranges::copy(result.velocity_jump_new_m_per_s(), request.f64(Field::kVelocityJump).begin());
}

void HistoryInput::check_all_rows() {
  std::vector<double> row(history_.nodes());
  for (const Column& column : fixed_) history_.per_node(column.dataset);
  for (std::size_t step = 0; step < history_.steps(); ++step)
    for (const Column& column : rows_) history_.row(column.dataset, step, row);
}

}  // namespace shearbus::replay
