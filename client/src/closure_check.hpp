// Compares the jump that a force-driven host brings with each step with the jump that its last committed step answered,
// and names the mistake of a host whose jump differs. Keeps the columns of the last step and of a trial.
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
  // `log` receives each warning; empty: standard error. kError: a difference throws, in every step; else the first
  // kStepsWatched steps are compared.
  ClosureCheck(CheckClosure mode, std::function<void(const std::string&)> log);

  // Compares the jumps of a request with the answers that it continues from. Called before the request is sent; throws
  // Error{kNotClosed} in mode kError.
  void compare(const Batch& request, std::span<const std::uint64_t> node_ids, const StepOptions& step);
  // Keeps a request and its answer, and passes on the server's warnings, one for each field that they are about. The
  // step has run, so nothing is thrown: without memory the check skips the next step.
  void answered(const Batch& request, const Batch& reply, const wire::Upscale& upscale, const StepOptions& step,
                wire::Mode mode) noexcept;
  void committed();    // the trial is the last step now
  void rolled_back();  // there is no trial any more
  void forget();       // the nodes or their states are others now

  static constexpr std::uint64_t kStepsWatched = 100;

 private:
  struct Kept {  // a step; its vectors keep their memory
    bool known = false;
    bool sticks = false;
    bool has_stress = false;
    double dt_before = 0.0, dt = 0.0;
    std::vector<closure::Row> rows;       // [component][row]
    std::vector<std::uint64_t> node_ids;  // of the rows; empty: all nodes of the session
    std::vector<bool> failed;             // rows without an answer
  };

  void warn(const std::string& warning) const;
  bool watches() const { return mode_ != CheckClosure::kOff && !(mode_ == CheckClosure::kWarn && done_); }
  std::string difference(const Kept& last, const Batch& request, std::span<const std::uint64_t> node_ids, double dt);
  void match(const Kept& last, std::span<const std::uint64_t> now);

  CheckClosure mode_;
  std::function<void(const std::string&)> log_;
  bool done_ = false;  // warned, or all steps watched
  std::uint64_t steps_ = 0;
  Kept last_, trial_;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> index_;    // ids and rows of the last step, sorted
  std::vector<std::pair<std::uint32_t, std::uint32_t>> matched_;  // row of the last step, row now
  std::vector<std::string> warned_;                               // fields that the server has warned about
};

}  // namespace shearbus
