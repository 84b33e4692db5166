#include "client/src/closure_check.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace shearbus {
namespace {

// number of nodes whose velocity jumps are used to find the host's mistake; more nodes would not show it more clearly
constexpr std::size_t kRowsDiagnosed = 256;

std::span<const double> column(const Batch& batch, Field field, std::size_t component = 0) {
  return batch.f64(field, static_cast<std::uint32_t>(component));
}

std::size_t components_of(const Batch& request) {
  return request.has(Field::kVelocityJump, 1) ? 2 : 1;
}

// Of one row: what the host's own stresses add to the jump in this step, or the jump without friction in stick form.
double coming(const Batch& request, double dt, std::size_t component, std::size_t row) {
  const auto value = [&](Field field, std::size_t of) {  // the request is not checked yet: a column may be missing
    const auto values = column(request, field, of);
    return row < values.size() ? values[row] : std::numeric_limits<double>::quiet_NaN();
  };
  if (request.has(Field::kImpedance)) return value(Field::kStickStress, component) / value(Field::kImpedance, 0);
  return dt * (value(Field::kStressSoft, component) / value(Field::kMassSoft, 0) +
               value(Field::kStressHard, component) / value(Field::kMassHard, 0));
}

}  // namespace

ClosureCheck::ClosureCheck(CheckClosure mode, std::function<void(const std::string&)> log)
    : mode_(mode), log_(std::move(log)) {}

// Describes a difference. Mistakes that explain it are alternatives.
std::string ClosureCheck::text_of(const Difference& found) const {
  if (units_are_doubtful_)
    return found.text + "A warning before this one doubts units: correct these first, which may be all.";
  if (found.mistakes.empty())
    return fmt::format(
        "{}No single mistake in signs, sides, masses, time levels or dt_s explains it. {}, is the answer applied times "
        "the area, is the jump that before the forces act? The guide's table of hosts (client/README.md) has hosts "
        "that "
        "change velocities in other ways.",
        found.text,
        found.sticks
            ? "Are stresses in Pa and the impedance in Pa s/m, is stick_stress the total one (a fault's initial "
              "stress is part of it, and is subtracted from the answer)"
            : "Are stresses in Pa and masses in kg/m2");
  return fmt::format("{}One change could explain it: {}.", found.text, fmt::join(found.mistakes, "; or: "));
}

void ClosureCheck::warn_once(const Difference& found) {
  done_ = warned_of_jumps_ = true;
  write_line(log_, "warning: " + text_of(found));
  waiting_.reset();
  last_ = trial_ = {};
}

void ClosureCheck::compare(const Batch& request, std::span<const std::uint64_t> node_ids, const StepOptions& step) {
  compared_ = false;
  if (!not_closed_.empty())
    throw Error({.code = Code::kNotClosed,
                 .text = not_closed_,
                 .remedy = "This step was not sent. Roll the session back, or correct the host and start again.",
                 .field = wire::name(Field::kVelocityJump)});
  if (!watches()) return;
  const Kept& last = step.commit_previous ? trial_ : last_;
  if (!last.known) return;
  compared_ = true;
  const bool goes_on = waiting_ && last.number != waiting_since_;
  std::optional<Difference> found = difference(last, request, node_ids, step.dt_s);
  if (!found) {
    if (!goes_on) return;
    auto& mistakes = waiting_->mistakes;
    if (std::ranges::find(mistakes, closure::kFirstKick) != mistakes.end()) mistakes = {closure::kFirstKick};
    warn_once(*waiting_);
    return;
  }
  if (mode_ == CheckClosure::kError)
    throw Error({.code = Code::kNotClosed,
                 .text = text_of(*found),
                 .remedy = "The step was not sent. Correct the host, or open with check_closure = 'warn' (in C and C++ "
                           "SHEARBUS_CHECK_WARN).",
                 .field = wire::name(Field::kVelocityJump)});
  if (found->mistakes.size() > 1 && !goes_on) {
    waiting_ = std::move(found);
    waiting_since_ = last.number;
    return;
  }
  if (goes_on)
    std::erase_if(found->mistakes, [&](const std::string& mistake) {
      return std::ranges::find(waiting_->mistakes, mistake) == waiting_->mistakes.end();
    });
  warn_once(*found);
}

void ClosureCheck::answered(const Batch& request, const Batch& reply, const wire::Upscale& upscale,
                            const StepOptions& step) noexcept try {
  for (const std::string& warning : upscale.warnings) {
    const std::string field = warning.substr(0, warning.find(':'));
    if (skips_clock_ && field == "time_s") continue;
    if (mode_ == CheckClosure::kOff || std::ranges::find(warned_, field) != warned_.end()) continue;
    warned_.push_back(field);
    write_line(log_, "warning: " + warning);
  }
  skips_clock_ = false;
  if (!compared_ && !std::exchange(lags_, false)) judge(request, upscale, step);
  if (!watches()) return;
  if (step.commit_previous) committed();
  trial_.known = false;
  const std::size_t components = components_of(request);
  const auto jump = column(request, Field::kVelocityJump);
  const auto answer = column(reply, Field::kVelocityJumpNew);
  if (answer.size() == jump.size() && !answer.empty()) {
    trial_.known = true;
    trial_.sticks = request.has(Field::kImpedance);
    trial_.has_stress = reply.has(Field::kShearStress);
    trial_.number = ++answered_;
    trial_.dt_before = last_.known ? last_.dt : 0.0;
    trial_.dt = step.dt_s;
    trial_.rows.resize(components * jump.size());
    const auto ids = request.u64(Field::kNodeId);
    trial_.node_ids.assign(ids.begin(), ids.end());
    for (std::size_t c = 0; c < components; ++c) {
      const std::span<closure::Row> rows = std::span(trial_.rows).subspan(c * jump.size(), jump.size());
      const auto put = [&](const Batch& batch, Field field, std::size_t component, double closure::Row::*member) {
        const auto values = column(batch, field, component);
        for (std::size_t row = 0; row < values.size(); ++row) rows[row].*member = values[row];
      };
      put(request, Field::kVelocityJump, c, &closure::Row::jump);
      put(reply, Field::kShearStress, c, &closure::Row::stress);
      put(reply, Field::kVelocityJumpNew, c, &closure::Row::answered);
      put(request, Field::kStressSoft, c, &closure::Row::stress_soft);
      put(request, Field::kStressHard, c, &closure::Row::stress_hard);
      put(request, Field::kMassSoft, 0, &closure::Row::mass_soft);
      put(request, Field::kMassHard, 0, &closure::Row::mass_hard);
      put(request, Field::kStickStress, c, &closure::Row::stick_stress);
      put(request, Field::kImpedance, 0, &closure::Row::impedance);
    }
    const auto outcome = reply.u8(Field::kOutcome);
    trial_.failed.assign(jump.size(), outcome.empty() && upscale.flagged_nodes > 0);
    for (std::size_t row = 0; row < outcome.size(); ++row) trial_.failed[row] = (outcome[row] & wire::kFailed) != 0;
    keep_before();
  }
  if (step.mode == wire::Mode::kAdvance) committed();
} catch (const std::exception&) {
  forget();
}

void ClosureCheck::judge(const Batch& request, const wire::Upscale& upscale, const StepOptions& step) {
  if (mode_ == CheckClosure::kOff || warned_of_jumps_) return;
  if (!(upscale.largest_closure_m_per_s > closure::tolerance({}))) return;  // of no jump: spares a look at all of them
  double largest = 0.0;  // jump of a node, which bounds what is accepted
  for (std::size_t c = 0; c < components_of(request); ++c)
    for (const double jump : column(request, Field::kVelocityJump, c)) largest = std::max(largest, std::abs(jump));
  if (!(upscale.largest_closure_m_per_s > closure::tolerance({.now = largest}))) return;
  std::string text = fmt::format(
      "closure: the host brought a jump for node {} that is {:.3g} m/s from the one that the node's last step was "
      "answered with. The layer's own time is now {:.9g} s{}. A host that goes back to a dump goes back in its "
      "session, too "
      "(rollback_to its mark)",
      upscale.closure_node, upscale.largest_closure_m_per_s, upscale.layer_time_s,
      step.time_s != 0.0 ? fmt::format(", the host's {:.9g} s", step.time_s) : "");
  if (mode_ == CheckClosure::kError) {
    not_closed_ = std::move(text);
    return;
  }
  warned_of_jumps_ = true;
  write_line(log_, "warning: " + text + "; check_closure = 'error' compares every step, and names the mistake");
}

void ClosureCheck::keep_before() {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  const bool first = steps_ == 0 && !last_.known;
  const bool same = last_.known && last_.sticks == trial_.sticks && last_.rows.size() == trial_.rows.size() &&
                    last_.node_ids == trial_.node_ids;
  for (std::size_t i = 0; i < trial_.rows.size(); ++i) {
    closure::Row& row = trial_.rows[i];
    row.change_before = row.friction_before = first ? 0.0 : kUnknown;
    row.answered_before = first ? row.jump : kUnknown;
    if (!same || last_.failed[i % last_.failed.size()]) continue;
    const closure::Row& before = last_.rows[i];
    row.change_before = before.answered - before.jump;
    row.friction_before = last_.dt * before.stress * (1.0 / before.mass_soft + 1.0 / before.mass_hard);
    row.answered_before = before.answered;
  }
}

void ClosureCheck::ended() {
  if (waiting_) warn_once(*waiting_);
}

void ClosureCheck::committed() {
  std::swap(last_, trial_);
  trial_.known = false;
  ++steps_;
  if (mode_ == CheckClosure::kError || steps_ < kStepsWatched || waiting_) return;
  done_ = true;
  last_ = trial_ = {};
}

void ClosureCheck::rolled_back() {
  trial_.known = false;
  not_closed_.clear();
}

void ClosureCheck::forget() {
  last_.known = trial_.known = false;
  skips_clock_ = true;
  not_closed_.clear();
}

void ClosureCheck::lag() {
  forget();
  lags_ = true;
}

void ClosureCheck::doubt_units() {
  units_are_doubtful_ = true;
}

// Fills matched_ with the positions of each node in the last step and in this one, if it is in both. Steps without node
// ids have the same nodes in the same order.
void ClosureCheck::match(const Kept& last, std::span<const std::uint64_t> now) {
  matched_.clear();
  const std::span<const std::uint64_t> before = last.node_ids;
  if (std::ranges::equal(before, now)) {
    for (std::uint32_t row = 0; row < last.failed.size(); ++row) matched_.emplace_back(row, row);
    return;
  }
  index_.clear();
  for (std::uint32_t row = 0; row < before.size(); ++row) index_.emplace_back(before[row], row);
  std::ranges::sort(index_);
  for (std::uint32_t row = 0; row < now.size(); ++row) {
    const auto found = std::ranges::lower_bound(index_, now[row], {}, &std::pair<std::uint64_t, std::uint32_t>::first);
    if (found != index_.end() && found->first == now[row]) matched_.emplace_back(found->second, row);
  }
}

// Finds the largest difference between the host's jumps and the answered ones, with the mistakes that explain it. None
// if no difference exceeds its tolerance.
std::optional<ClosureCheck::Difference> ClosureCheck::difference(const Kept& last, const Batch& request,
                                                                 std::span<const std::uint64_t> node_ids, double dt) {
  const auto jump = column(request, Field::kVelocityJump);
  const auto ids = request.has(Field::kNodeId) ? request.u64(Field::kNodeId) : node_ids;
  if (last.node_ids.empty() != !request.has(Field::kNodeId))
    return std::nullopt;  // only one of the two steps names its nodes
  match(last, request.u64(Field::kNodeId));
  const std::size_t rows_before = last.failed.size();
  const std::size_t components =
      std::min(components_of(request), last.rows.size() / std::max<std::size_t>(rows_before, 1));
  const auto row_at = [&](std::size_t component, const auto& rows) {
    closure::Row row = last.rows[component * rows_before + rows.first];
    row.now = column(request, Field::kVelocityJump, component)[rows.second];
    row.coming = last.sticks == request.has(Field::kImpedance) ? coming(request, dt, component, rows.second)
                                                               : std::numeric_limits<double>::quiet_NaN();
    return row;
  };
  closure::Row worst;
  std::uint32_t worst_row = 0;
  std::size_t wrong = 0, compared = 0;
  double excess = 1.0;
  for (const auto& rows : matched_) {
    if (last.failed[rows.first] || rows.second >= jump.size()) continue;
    ++compared;
    double most = 0.0;
    for (std::size_t c = 0; c < components; ++c) {
      const closure::Row row = row_at(c, rows);
      const double ratio = std::abs(row.difference()) / closure::tolerance(row);
      if (ratio > excess) {
        excess = ratio;
        worst = row;
        worst_row = rows.second;
      }
      most = std::max(most, ratio);
    }
    wrong += most > 1.0;
  }
  if (wrong == 0) return std::nullopt;

  std::vector<closure::Row> rows = {worst};
  const std::size_t stride = matched_.size() / kRowsDiagnosed + 1;
  for (std::size_t i = 0; i < matched_.size(); i += stride)
    for (std::size_t c = 0; c < components && !last.failed[matched_[i].first]; ++c)
      rows.push_back(row_at(c, matched_[i]));
  Difference found{
      .text = fmt::format(
          "closure: the host brings a jump of {:.9g} m/s for node {}; its last step was answered with {:.9g} m/s, and "
          "a host that applies the answered stress has that jump but for rounding ({} of {} nodes differ, this one by "
          "{:.3g} m/s). ",
          worst.now, ids[worst_row], worst.answered, wrong, compared, worst.difference()),
      .mistakes = {},
      .sticks = last.sticks};
  std::vector<closure::Row> all;
  for (const auto& matched : matched_)
    if (!last.failed[matched.first] && matched.second < jump.size()) all.push_back(row_at(0, matched));
  if (wrong > 1 && closure::in_another_order(all))
    found.mistakes = {
        "these are the jumps answered, in another order: keep the rows of a step in the order in which "
        "the nodes were opened, or name each row's node"};
  else if (last.has_stress)
    found.mistakes =
        last.sticks ? closure::stick_mistakes(rows) : closure::far_field_mistakes(rows, {last.dt_before, last.dt, dt});
  return found;
}

}  // namespace shearbus
