// Finds the datasets of a history that a scene needs, and fills the requests of the replay from them.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "client/replay/bus.hpp"
#include "client/replay/table.hpp"

namespace shearbus::replay {

class HistoryInput {
 public:
  // Throws Error{kInvalidValue} that names every dataset that the strategy of the scene needs and the history lacks.
  // `closed_loop`: in a force-driven scene the new jump of each reply is the next input, even if the history has
  // /velocity_jump.
  HistoryInput(Table& history, const wire::SessionOpened& session, bool closed_loop);

  const std::vector<Field>& optional_columns() const { return optional_columns_; }
  // form of the requests: stick form if the history has the columns of that form and lacks those of the far-field form
  Form form() const { return form_; }
  bool force_driven() const { return force_driven_; }
  const std::string& jump_origin() const { return jump_origin_; }  // source of the velocity jump, for the summary
  const std::vector<std::string>& notes() const { return notes_; }

  void prepare(Batch& request) const;  // sets the values that hold for all steps; in a closed loop also the first jump
  void fill(std::size_t step, Batch& request);                 // sets the values of one step
  void feed_back(const Answer& answer, Batch& request) const;  // in a closed loop, sets the jump of the next step
  void check_all_rows();                                       // reads every value once, to find faults

 private:
  struct Column {
    Field field;
    std::uint32_t component = 0;
    std::string dataset;
  };
  void require_rows(Field field);
  void require_constant(Field field);
  void use_optional(Field field, const wire::SessionOpened& session);
  void choose_form();
  void choose_jump(bool closed_loop);
  void refuse_what_is_missing(const wire::SessionOpened& session) const;
  void note_near_misses(const wire::SessionOpened& session);

  Table& history_;
  bool force_driven_;
  Form form_ = Form::kFarField;
  std::uint32_t components_;  // number of tangential components of slip and stress
  bool closed_loop_ = false;
  std::vector<Column> rows_;       // columns with one value per step and node, [step][node]
  std::vector<Column> constants_;  // columns with one value per node
  std::vector<std::string> missing_;
  std::vector<Field> optional_columns_;
  std::vector<double> first_jump_[2];  // first velocity jump of each component, one value per node
  std::string jump_origin_;
  std::vector<std::string> notes_;
};

}  // namespace shearbus::replay
