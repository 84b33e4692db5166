// A force-driven host must send the velocity jumps that the server answered to its last committed step. This check
// compares them and names the mistake of a host whose jumps differ. It keeps the columns of that step and of a trial.
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
  void committed();    // the kept trial step becomes the last step
  void rolled_back();  // drops the kept trial step
  void forget();       // for new nodes or restored states: the next step is not compared

  static constexpr std::uint64_t kStepsWatched = 100;

 private:
  struct Kept {  // columns of one step; reused, so that later steps allocate nothing
    bool known = false;
    bool sticks = false;
    bool has_stress = false;
    double dt_before = 0.0, dt = 0.0;
    std::vector<closure::Row> rows;       // values of a node: [component of the jump][the request's row]
    std::vector<std::uint64_t> node_ids;  // node of each row; empty: all nodes of the session
    std::vector<bool> failed;             // true for rows without an answer
  };

  void warn(const std::string& warning) const;
  bool watches() const { return mode_ != CheckClosure::kOff && !(mode_ == CheckClosure::kWarn && done_); }
  std::string difference(const Kept& last, const Batch& request, std::span<const std::uint64_t> node_ids, double dt);
  void match(const Kept& last, std::span<const std::uint64_t> now);

  CheckClosure mode_;
  std::function<void(const std::string&)> log_;
  bool done_ = false;  // mode kWarn: true after a warning about jumps or kStepsWatched steps; ends the check
  std::uint64_t steps_ = 0;
  Kept last_, trial_;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> index_;  // (node id, row in the last step's request), sorted
  // For each node in both steps: its row in the last step's request, and that in the present request.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> matched_;
  std::vector<std::string> warned_;  // fields that the server has warned about
};

}  // namespace shearbus
