#include "server/physics/solver/around/tolerance.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "server/physics/layer/modes.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/scratch.hpp"

namespace shearbus::physics {
namespace {

// Error budget of a step, as a fraction of the tolerance.
constexpr double kStepShare = 0.25;
// A substep may use a share of the remaining error budget, the largest of three: length of the substep / remaining time
// of the step; kEarlyShare * length of the substep / time from the start of the step to the end of the substep; and
// kRefinedShare, if the substep was shortened because of its error.
constexpr double kEarlyShare = 0.05;    // smallest share of the budget for the first substep, where inputs may jump
constexpr double kRefinedShare = 0.25;  // smallest share of the budget for a substep shortened because of its error
// The next substep may be twice as long if the error was below this fraction of the error budget of the substep.
constexpr double kSmallError = 1.0 / 6.0;

constexpr double kJumpTime = 1e-6;    // time for which friction is taken to act with a wrong velocity jump  [s]
constexpr double kLeastRange = 0.01;  // smallest temperature range that a tolerance refers to, relative to T_melt
constexpr int kMostHalvings = 22;     // largest number of times that a step is halved
// Largest number of substeps tried in one step of a lane; the rest is then accepted whatever its estimated error.
constexpr int kMostAttempts = 1024;
constexpr int kHurriedPieces = 64;  // approximate number of substeps that follow after kMostAttempts

// The answer of one substep of a lane: the members of TileOutputs that the sum over substeps needs.
struct Answer {
  double stress = 0.0, slip = 0.0, T0 = 0.0, jump_new = 0.0, heat = 0.0;
  Regime regime = Regime::kOpen;
  std::uint8_t outcome = 0;
};
Answer answer_of(const TileOutputs& out, int l) {
  return {out.shear_stress[l],
          out.sliding_velocity[l],
          out.interface_temperature[l],
          out.velocity_jump_new[l],
          out.friction_heat[l],
          out.regime[l],
          out.outcome[l]};
}

// Adds a substep, whose length is the fraction `share` of the step, to the answer of the substeps before it. The
// force-driven answer is the mean stress, with which the host exchanges momentum; the velocity-driven answer is the
// stress at the end.
void add(const Answer& next, double share, bool forced, Answer& sum) {
  sum.stress = forced ? sum.stress + share * next.stress : next.stress;
  sum.slip += share * next.slip;
  sum.T0 = next.T0;
  sum.jump_new = next.jump_new;
  sum.heat += next.heat;
  sum.regime = next.regime;
  sum.outcome |= next.outcome;
}

// Progress of one lane through its step.
struct Progress {
  int level = 0;        // the next substep is dt / 2^level long
  std::int64_t at = 0;  // begin of the next substep, in units of the shortest substep
  Answer sum;           // answer of the accepted substeps together
  Answer coarse;        // answer of the next substep solved in one piece, if coarse_known
  bool coarse_known = true;
  bool refined = false;  // the next substep was shortened because of its error
  int attempts = 0;
  double left = 0.0;  // remaining error budget of T0, relative to T_melt less the initial temperature
  // sum of the estimated errors of T0 of the accepted substeps, relative to T_melt less the initial temperature
  double estimate = 0.0;
};

// Error of the velocity jump at the end of a substep in which the jump reverses or stops; `before` and `after` are the
// jump at the two ends of the substep. One stress s acts over the whole substep, although friction really has the other
// sign until the reversal. Both halves of the substep can have this error, so comparing them does not show it. Let the
// jump change by A in the substep, to which s contributes b s. The true rate of change is A + 2 b s per substep until
// the reversal, and A afterwards: the returned error is the difference. If the jump stops although the far stresses
// are larger than the friction before the substep, the stop is doubtful and the error is bounded by the old jump.
double turning_error(const Forcing& forcing, double dt, double before, double after, double stress_before,
                     double stress) {
  if (before == 0.0 || before * after > 0.0) return 0.0;
  if (after == 0.0) {
    const bool holds = std::abs(forcing.acceleration) <= forcing.mobility * std::abs(stress_before);
    return holds ? 0.0 : std::abs(before);
  }
  const double rise = std::abs(before) + std::abs(after);
  const double turned = 2.0 * dt * forcing.mobility * std::abs(stress);
  return std::abs(before) / (1.0 + rise / turned);
}

// Each lane (one of 8 nodes stepped together) has substeps of its own. A substep is solved in one piece and in two
// halves, and is accepted if the two answers differ by no more than its error budget; otherwise its first half becomes
// the next substep. After a small error the next substep may be twice as long. Lanes whose next substeps are equally long
// are solved together, the shortest first. The substeps of a lane depend on its own state and inputs alone.
class ControlledStep {
 public:
  ControlledStep(const Problem& problem, const StepOperators& operators, AdvanceTile advance, const TileInputs& inputs,
                 const double* committed, double* trial, TileOutputs& outputs)
      : now_(inputs),
        problem_(problem),
        operators_(operators),
        advance_(advance),
        inputs_(inputs),
        committed_(committed),
        trial_(trial),
        outputs_(outputs),
        end_(std::int64_t{1} << operators.most_times_halved()),
        response_(problem.modes ? operators.modes().response : operators.heat().layer_response()[0]),
        accepted_(scratch_tile(Scratch::kAccepted, problem.layout.doubles)),
        half_(scratch_tile(Scratch::kFirstHalf, problem.layout.doubles)),
        fine_(scratch_tile(Scratch::kSecondHalf, problem.layout.doubles)),
        deepest_(operators.most_times_halved()),
        open_(inputs.active),
        forced_(problem.options.strategy == Strategy::kForceDriven) {}

  void run() {
    begin();
    while (open_ != 0) {
      int level = 0;
      for (const int l : lanes_of(open_)) level = std::max(level, lanes_[l].level);
      std::uint32_t together = 0;
      for (const int l : lanes_of(open_)) {
        if (lanes_[l].level == level) together |= 1u << l;
      }
      solve(level, together);
      for (const int l : lanes_of(together)) accept_or_refine(l);
    }
  }

 private:
  // Solves the whole step of all active lanes in one piece.
  void begin() {
    const std::size_t stress = problem_.layout.shear_stress;
    advance_(problem_, operators_, inputs_, committed_, trial_, outputs_);
    now_.stress_before = nullptr;  // null: a substep takes its initial stress from the accepted state
    std::copy_n(committed_, problem_.layout.doubles, accepted_);
    for (const int l : lanes_of(open_)) {
      lanes_[l].coarse = answer_of(outputs_, l);
      lanes_[l].left = kStepShare * *problem_.options.tolerance;
      if (inputs_.stress_before) accepted_[stress + static_cast<std::size_t>(l)] = inputs_.stress_before[l];
    }
  }

  // Solves the next substep of the lanes `together` in one piece, unless that answer is known, and in two halves.
  void solve(int level, std::uint32_t together) {
    now_.active = 0;
    for (const int l : lanes_of(together)) {
      if (!lanes_[l].coarse_known) now_.active |= 1u << l;
    }
    if (now_.active != 0) {
      TileOutputs piece{};
      advance_(problem_, operators_.halved(level), now_, accepted_, half_, piece);
      for (const int l : lanes_of(now_.active)) lanes_[l].coarse = answer_of(piece, l);
    }
    const StepOperators& halves = operators_.halved(level + 1);
    now_.active = together;
    advance_(problem_, halves, now_, accepted_, half_, first_);
    TileInputs then = now_;
    if (forced_) std::copy_n(first_.velocity_jump_new, kLanes, then.velocity_jump);
    advance_(problem_, halves, then, half_, fine_, second_);
  }

  void accept_or_refine(int l) {
    Progress& lane = lanes_[l];
    const Answer one = answer_of(first_, l), two = answer_of(second_, l);
    if (((one.outcome | two.outcome) & kFailed) != 0) {
      open_ &= ~(1u << l);
      keep_lane(problem_, inputs_, committed_, trial_, l, outputs_);
      outputs_.error_estimate[l] = 0.0;
      return;
    }
    const std::int64_t length = end_ >> lane.level;
    const double of_rest = static_cast<double>(length) / static_cast<double>(end_ - lane.at);
    const double of_past = static_cast<double>(length) / static_cast<double>(lane.at + length);
    const double error = error_of(l, one, two, of_rest);
    const double share = lane.left * std::max(of_rest, kEarlyShare * of_past);
    const double allowed = lane.refined ? std::max(share, kRefinedShare * lane.left) : share;
    const bool hurries = ++lane.attempts > kMostAttempts;
    if (error > allowed && lane.level + 1 < deepest_ && !hurries) {
      ++lane.level;
      lane.coarse = one;
      lane.coarse_known = true;
      lane.refined = true;
      return;
    }
    copy_lane(fine_, accepted_, problem_.layout.doubles, l);
    if (forced_) now_.velocity_jump[l] = two.jump_new;
    const double half = std::ldexp(0.5, -lane.level);
    add(one, half, forced_, lane.sum);
    add(two, half, forced_, lane.sum);
    lane.estimate += error;
    // A substep may be accepted with an error above the allowed one. The remaining budget is then raised to this error,
    // so that the later substeps are not made much more accurate than this one.
    lane.left = error > allowed ? std::max(lane.left, error) : lane.left - error;
    lane.at += length;
    lane.coarse_known = false;
    lane.refined = false;
    const bool fits = lane.level > 0 && lane.at % (2 * length) == 0;
    if (fits && (hurries ? end_ - lane.at > kHurriedPieces * length : error <= kSmallError * share)) --lane.level;
    if (lane.at == end_) finish(l);
  }

  // Estimates the error that a substep causes in T0 at the end of the step, relative to T_melt less the initial
  // temperature. Its answers in one piece and in two halves differ in T0, the heat released and the velocity jump.
  // Each difference is converted to a change of T0: diffusion damps that of T0, and a wrong jump keeps heating wrongly.
  // The largest is the estimate. `of_rest`: length of the substep relative to the rest of the step.
  double error_of(int l, const Answer& one, const Answer& two, double of_rest) const {
    const Answer& coarse = lanes_[l].coarse;
    const double dt = operators_.dt();
    const double T0 = std::abs(two.T0 - coarse.T0) * (of_rest * std::sqrt(of_rest));
    const double heat = response_ / dt * std::abs(one.heat + two.heat - coarse.heat);
    double jump = 0.0;
    if (forced_) {
      const Forcing forcing = forcing_of(inputs_, l);
      const double half = std::ldexp(0.5 * dt, -lanes_[l].level);
      const double stress_before = accepted_[problem_.layout.shear_stress + static_cast<std::size_t>(l)];
      const double off = std::abs(two.jump_new - coarse.jump_new) +
                         turning_error(forcing, half, now_.velocity_jump[l], one.jump_new, stress_before, one.stress) +
                         turning_error(forcing, half, one.jump_new, two.jump_new, one.stress, two.stress);
      const double stress = std::max(std::abs(two.stress), std::abs(coarse.stress));
      jump = std::sqrt(std::max(1.0, kJumpTime / dt)) * problem_.heat_partition * response_ * stress * off;
    }
    const double T_melt = problem_.options.soft.melting_temperature;
    const double range = std::max(T_melt - problem_.options.initial_temperature, kLeastRange * T_melt);
    return std::max({T0, heat, jump}) / range;
  }

  // The sum of the substeps becomes the answer of the host's step.
  void finish(int l) {
    const Answer& sum = lanes_[l].sum;
    open_ &= ~(1u << l);
    copy_lane(accepted_, trial_, problem_.layout.doubles, l);
    trial_[problem_.layout.shear_stress + static_cast<std::size_t>(l)] = sum.stress;
    outputs_.error_estimate[l] = lanes_[l].estimate;
    outputs_.shear_stress[l] = sum.stress;
    // The mean slip could oppose the mean stress where the slip reverses; friction does no negative work.
    outputs_.sliding_velocity[l] = sum.stress * sum.slip < 0.0 ? 0.0 : sum.slip;
    outputs_.interface_temperature[l] = sum.T0;
    outputs_.velocity_jump_new[l] = sum.jump_new;
    outputs_.friction_heat[l] = sum.heat;
    outputs_.regime[l] = sum.regime;
    outputs_.outcome[l] = sum.outcome;
    if (forced_) return;
    outputs_.outcome[l] &= static_cast<std::uint8_t>(~kOutsideDomain);
    outputs_.outcome[l] |= outside_domain(sum.slip, inputs_.velocity_jump[l]);
  }

  TileInputs now_;                  // inputs of the next substep
  TileOutputs first_{}, second_{};  // answers of the two halves of the next substep
  const Problem& problem_;
  const StepOperators& operators_;
  const AdvanceTile advance_;  // solves one substep
  const TileInputs& inputs_;
  const double* committed_;
  double* trial_;
  TileOutputs& outputs_;
  const std::int64_t end_;  // end of the step, in units of its shortest substep
  const double response_;   // response B0 of T0 to a unit flux over the whole step  [K m2/W]
  double* const accepted_;  // state after the substeps accepted so far
  double* const half_;      // state after the first half of the next substep
  double* const fine_;      // state after both halves of the next substep
  Progress lanes_[kLanes];
  const int deepest_;
  std::uint32_t open_;  // lanes that have not reached the end of the step
  const bool forced_;
};

}  // namespace

int most_times_halved(double dt) {
  const double shortest = kShortestControlledStep / HeatModes::kHalvingsCovered;
  return std::clamp(std::ilogb(dt / shortest), 1, kMostHalvings);
}

void advance_controlled(const Problem& problem, const StepOperators& operators, AdvanceTile advance,
                        const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs) {
  ControlledStep(problem, operators, advance, inputs, committed, trial, outputs).run();
}

}  // namespace shearbus::physics
