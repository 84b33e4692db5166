// A force-driven host must send the velocity jumps that the server answered to its last committed step. This check
// compares them and names the mistake of a host whose jumps differ. It keeps the columns of that step and of a trial.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/src/diagnosis.hpp"
#include "client/src/options.hpp"

namespace shearbus {

class ClosureCheck {
 public:
  // `log` receives each warning; without it warnings go to standard error. kError compares every step and throws at a
  // difference; kWarn compares the first kStepsWatched steps. Of a step that was not compared, such as the first one of a
  // resumed session, the server's own comparison tells: kWarn warns of it, and kError refuses the step after it.
  ClosureCheck(CheckClosure mode, std::function<void(const std::string&)> log);

  // Compares the jumps of a request with the answers to the step that it continues. Called before the request is sent;
  // throws Error{kNotClosed} in mode kError.
  void compare(const Batch& request, std::span<const std::uint64_t> node_ids, const StepOptions& step);
  // Keeps a request and its answer, and passes on the server's warnings, the first one for each field. Throws nothing,
  // because the step has run: if memory runs out, the check skips the next step.
  void answered(const Batch& request, const Batch& reply, const wire::Upscale& upscale,
                const StepOptions& step) noexcept;
  void committed();    // the kept trial step becomes the last step
  void rolled_back();  // drops the kept trial step
  void ended();        // the session ends: shows a warning that waited for another step
  void forget();       // for new nodes and restored states: the next step and its clock are not compared
  void lag();          // for a server that was away: the same, and the server does not know the host's jumps either
  void doubt_units();  // a warning was shown about units: no mistake is named before they are right

  static constexpr std::uint64_t kStepsWatched = 100;

 private:
  struct Kept {  // columns of one step; reused, so that later steps allocate nothing
    bool known = false;
    bool sticks = false;
    bool has_stress = false;
    std::uint64_t number = 0;  // counts the answered steps
    double dt_before = 0.0, dt = 0.0;
    std::vector<closure::Row> rows;       // values of a node: [component of the jump][the request's row]
    std::vector<std::uint64_t> node_ids;  // node of each row; empty: all nodes of the session
    std::vector<bool> failed;             // true for rows without an answer
  };

  // The largest difference between the host's jumps and the answered ones, with the mistakes that explain all of them.
  struct Difference {
    std::string text;
    std::vector<std::string> mistakes;
    bool sticks = false;  // of a step in stick form
  };
  std::string text_of(const Difference& found) const;

  void warn_once(const Difference& found);
  // Takes the server's comparison of a step that was not compared.
  void judge(const Batch& request, const wire::Upscale& upscale, const StepOptions& step);
  bool watches() const { return mode_ != CheckClosure::kOff && !(mode_ == CheckClosure::kWarn && done_); }
  std::optional<Difference> difference(const Kept& last, const Batch& request, std::span<const std::uint64_t> node_ids,
                                       double dt);
  void keep_before();  // fills what the rows of the trial step say of the step before it
  void match(const Kept& last, std::span<const std::uint64_t> now);

  CheckClosure mode_;
  std::function<void(const std::string&)> log_;
  bool units_are_doubtful_ = false;
  bool skips_clock_ = false;  // true: the layers may lag behind the host's clock, once
  bool lags_ = false;         // true: the layers may lag behind the host's jumps, once
  bool compared_ = false;     // whether the step that is on its way was compared
  bool warned_of_jumps_ = false;
  std::string not_closed_;      // mode kError: what the server found in a step that was not compared
  bool done_ = false;           // mode kWarn: true after a warning about jumps or kStepsWatched steps; ends the check
  std::uint64_t steps_ = 0;     // committed
  std::uint64_t answered_ = 0;  // number of the newest answered step
  Kept last_, trial_;
  // Mode kWarn: a difference that several mistakes explain. The next step tells which, so the warning waits for it.
  std::optional<Difference> waiting_;
  std::uint64_t waiting_since_ = 0;                             // number of the last step then
  std::vector<std::pair<std::uint64_t, std::uint32_t>> index_;  // (node id, row in the last step's request), sorted
  // For each node in both steps: its row in the last step's request, and that in the present request.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> matched_;
  std::vector<std::string> warned_;  // fields that the server has warned about
};

}  // namespace shearbus
