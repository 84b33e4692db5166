// Compares the velocity jumps in each request of a force-driven host with the jumps that its last committed step
// answered, and names the mistake of a host whose jumps differ. Keeps the columns of the last step and of a trial.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/src/client.hpp"
#include "client/src/diagnosis.hpp"

namespace shearbus {

class ClosureCheck {
 public:
  // `log` receives each warning; without it warnings go to standard error. kError compares every step and throws at a
  // difference; kWarn compares the first kStepsWatched steps.
  ClosureCheck(CheckClosure mode, std::function<void(const std::string&)> log);

  // Compares the jumps of a request with the answers to the step that it continues. Called before the request is sent;
  // throws Error{kNotClosed} in mode kError.
  void compare(const Batch& request, std::span<const std::uint64_t> node_ids, const StepOptions& step);
  // Keeps a request and its answer, and passes on the server's warnings, the first one for each field. Throws nothing,
  // because the step has run: if memory runs out, the check skips the next step.
  void answered(const Batch& request, const Batch& reply, const wire::Upscale& upscale, const StepOptions& step,
                wire::Mode mode) noexcept;
  void committed();    // the trial becomes the last step
  void rolled_back();  // drops the trial
  void forget();       // for new nodes or restored states: the next step is not compared

  static constexpr std::uint64_t kStepsWatched = 100;

 private:
  struct Kept {  // the columns of one step; the vectors are reused
    bool known = false;
    bool sticks = false;
    bool has_stress = false;
    double dt_before = 0.0, dt = 0.0;
    std::vector<closure::Row> rows;       // a Row per component and row: [component][row]
    std::vector<std::uint64_t> node_ids;  // node of each row; empty: all nodes of the session
    std::vector<bool> failed;             // true for rows without an answer
  };

  void warn(const std::string& warning) const;
  bool watches() const { return mode_ != CheckClosure::kOff && !(mode_ == CheckClosure::kWarn && done_); }
  std::string difference(const Kept& last, const Batch& request, std::span<const std::uint64_t> node_ids, double dt);
  void match(const Kept& last, std::span<const std::uint64_t> now);

  CheckClosure mode_;
  std::function<void(const std::string&)> log_;
  bool done_ = false;  // true after the warning, or after kStepsWatched steps
  std::uint64_t steps_ = 0;
  Kept last_, trial_;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> index_;  // (node id, row) of the last step, sorted
  // (row of the last step, row of this step) of each common node
  std::vector<std::pair<std::uint32_t, std::uint32_t>> matched_;
  std::vector<std::string> warned_;  // fields that the server has warned about
};

}  // namespace shearbus
