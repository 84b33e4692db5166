#include "client/replay/history_input.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "proto/wire/numbers.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::replay {

HistoryInput::HistoryInput(Table& history, const wire::SessionOpened& session, bool closed_loop)
    : history_(history),
      force_driven_(session.strategy == wire::Strategy::kForceDriven),
      components_(session.tangential_components) {
  if (closed_loop && !force_driven_)
    throw Error({.code = Code::kInvalidValue,
                 .text = fmt::format("a closed loop needs strategy force_driven; scene \"{}\" has velocity_driven",
                                     session.scene_name),
                 .remedy = "Leave --closed-loop out: the history imposes the jump."});
  if (force_driven_) choose_form();
  for (const Field field : wire::columns_in(form_, session.required_columns)) {
    if (field == Field::kVelocityJump && force_driven_)
      choose_jump(closed_loop);
    else if (is_per_node(field))
      require_constant(field);
    else
      require_rows(field);
  }
  if (!force_driven_) jump_origin_ = "imposed by /velocity_jump";
  for (const Field field : wire::columns_of(session.strategy).optional) use_optional(field, session);
  refuse_what_is_missing(session);
  note_near_misses(session);
}

// A dataset that nothing reads and whose name is nearly that of an optional one was probably meant for it.
void HistoryInput::note_near_misses(const wire::SessionOpened& session) {
  const auto columns = wire::columns_of(session.strategy);
  std::vector<std::string> known = {"time", "node_id"}, optional = {"dt", "initial_temperature", "pair", "parameter"};
  for (const Field field : columns.optional) optional.push_back(wire::quantity_of(field));
  for (const auto& fields : {columns.required, columns.stick, columns.reply, columns.on_request})
    for (const Field field : fields) known.push_back(wire::quantity_of(field));
  std::erase_if(optional, [&](const std::string& name) { return history_.has(name); });
  const std::vector<std::string_view> absent(optional.begin(), optional.end());
  for (const std::string& name : history_.names_in("")) {
    if (std::ranges::find(known, name) != known.end()) continue;
    const std::string first = name.substr(0, name.rfind("_second"));
    if (components_ == 1 && first != name && history_.has(first))
      notes_.push_back(
          fmt::format("/{} is not used: the scene has tangential_components = 1", wire::as_utf8(name, 60)));
    const std::string_view near = wire::nearest(name, absent);
    if (!near.empty() && near != name)
      notes_.push_back(fmt::format("/{} is not used; did you mean /{}?", wire::as_utf8(name, 60), near));
  }
}

void HistoryInput::require_rows(Field field) {
  for (std::uint32_t component = 0; component < (wire::is_tangential(field) ? components_ : 1); ++component) {
    const std::string dataset = wire::quantity_of(field, component);
    if (history_.has(dataset))
      rows_.push_back({field, component, dataset});
    else
      missing_.push_back(fmt::format("/{} [T,N]", dataset));
  }
}

void HistoryInput::require_constant(Field field) {
  const std::string dataset = wire::quantity_of(field);
  if (history_.has(dataset))
    constants_.push_back({field, 0, dataset});
  else
    missing_.push_back(fmt::format("/{} [N]", dataset));
}

void HistoryInput::use_optional(Field field, const wire::SessionOpened& session) {
  const std::string dataset = wire::quantity_of(field);
  if (!history_.has(dataset)) return;
  if (std::ranges::find(session.optional_columns, field) == session.optional_columns.end()) {
    notes_.push_back(fmt::format("/{} is not used: {}", dataset,
                                 field == Field::kSoftPlasticStrainRate
                                     ? "without interface.plastic_layer there is no plastic strain to set against it"
                                     : "drive layer_shear takes the jump instead"));
    return;
  }
  require_rows(field);
  optional_columns_.push_back(field);
}

void HistoryInput::choose_form() {
  const auto has_any = [&](std::span<const Field> fields) {
    return std::ranges::any_of(fields, [&](Field field) { return history_.has(wire::quantity_of(field)); });
  };
  if (!has_any(wire::kStickColumns)) return;
  if (has_any(wire::kFarFieldColumns))
    notes_.emplace_back("/stick_stress and /impedance are not used: the far-field stresses or masses are there");
  else
    form_ = Form::kStick;
}

void HistoryInput::choose_jump(bool closed_loop) {
  const bool recorded = history_.has("velocity_jump");
  const bool initial = history_.has("initial_velocity_jump");
  if (!recorded && !initial) {
    missing_.emplace_back("/velocity_jump [T,N] (as recorded) or /initial_velocity_jump [N] (closed loop)");
    return;
  }
  closed_loop_ = closed_loop || !recorded;
  if (closed_loop_ && form_ == Form::kStick)
    throw Error(
        {.code = Code::kInvalidValue,
         .text = "a closed loop needs far-field stresses: /stick_stress contains the jump that the host had, so "
                 "no other jump can be the next input",
         .remedy = recorded ? "Leave --closed-loop out: the history has /velocity_jump."
                            : "Record /velocity_jump, or /stress_soft, /stress_hard, /mass_soft and /mass_hard.",
         .field = "stick_stress"});
  if (!closed_loop_) {
    require_rows(Field::kVelocityJump);
    jump_origin_ = "as recorded in /velocity_jump";
    if (initial)
      notes_.emplace_back("/initial_velocity_jump is not used: /velocity_jump is there; --closed-loop would use it");
    return;
  }
  const std::string from = initial ? "initial_velocity_jump" : "velocity_jump";
  jump_origin_ =
      initial ? "closed loop from /initial_velocity_jump" : "closed loop from the first row of /velocity_jump";
  for (std::uint32_t component = 0; component < components_; ++component) {
    const std::string name = component == 0 ? from : from + "_second";
    if (!history_.has(name)) {
      missing_.push_back(fmt::format("/{} [{}]", name, initial ? "N" : "T,N"));
    } else if (initial) {
      first_jump_[component] = history_.per_node(name);
    } else {
      first_jump_[component].resize(history_.nodes());
      history_.row(name, 0, first_jump_[component]);
    }
  }
}

void HistoryInput::refuse_what_is_missing(const wire::SessionOpened& session) const {
  if (missing_.empty()) return;
  const char* const other = force_driven_ ? "velocity_driven" : "force_driven";
  const bool looks_like_the_other = force_driven_ ? history_.has("velocity_jump") && !history_.has("stress_soft")
                                                  : history_.has("stress_soft") && history_.has("mass_soft");
  constexpr std::size_t kMostNames = 40;
  std::vector<std::string> names = history_.names_in("");
  std::string meant;
  for (const std::string& one : missing_) {
    const std::string name = one.substr(1, one.find(' ') - 1);
    std::vector<std::string> lower = names;
    for (std::string& one_name : lower) std::ranges::transform(one_name, one_name.begin(), wire::ascii_lower);
    const std::vector<std::string_view> views(lower.begin(), lower.end());
    const std::string_view near = wire::nearest(name, views);
    if (near.empty()) continue;
    const auto at = static_cast<std::size_t>(std::ranges::find(views, near) - views.begin());
    if (history_.has(name) || near == name) continue;
    meant += fmt::format("; did you mean {} by {}?", name, wire::in_quotes(names[at]));
  }
  if (names.size() > kMostNames) names.resize(kMostNames);
  for (std::string& name : names) name = wire::as_utf8(name, 60);
  throw Error(
      {.code = Code::kInvalidValue,
       .text = fmt::format("the history does not fit scene \"{}\": strategy {} needs {}, which it lacks; it has "
                           "{}{}",
                           session.scene_name, force_driven_ ? "force_driven" : "velocity_driven",
                           fmt::join(missing_, ", "), fmt::join(names, ", "), meant),
       .remedy = looks_like_the_other ? fmt::format("It looks like one for strategy {}.", other)
                                      : "See client/replay/README.md for what a history holds.",
       .field = "strategy"});
}

void HistoryInput::prepare(Batch& request) const {
  for (const Column& column : constants_)
    std::ranges::copy(history_.per_node(column.dataset), request.f64(column.field).begin());
  for (std::uint32_t component = 0; closed_loop_ && component < components_; ++component)
    std::ranges::copy(first_jump_[component], request.f64(Field::kVelocityJump, component).begin());
}

void HistoryInput::fill(std::size_t step, Batch& request) {
  for (const Column& column : rows_) history_.row(column.dataset, step, request.f64(column.field, column.component));
}

void HistoryInput::feed_back(const Answer& answer, Batch& request) const {
  for (std::uint32_t component = 0; closed_loop_ && component < components_; ++component)
    std::ranges::copy(std::as_const(answer.columns).f64(Field::kVelocityJumpNew, component),
                      request.f64(Field::kVelocityJump, component).begin());
}

void HistoryInput::check_all_rows() {
  std::vector<double> row(history_.nodes());
  for (const Column& column : constants_) history_.per_node(column.dataset);
  for (std::size_t step = 0; step < history_.steps(); ++step)
    for (const Column& column : rows_) history_.row(column.dataset, step, row);
}

}  // namespace shearbus::replay
