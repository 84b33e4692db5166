#include "server/physics/solver/around/tolerance.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "server/physics/layer/modes.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/scratch.hpp"

namespace shearbus::physics {
namespace {

constexpr double kStepShare = 0.25;  // of the tolerance: what a step may change when its substeps are halved
// Of what is left of that a substep may take what it is of the rest of the step, and at least
constexpr double kEarlyShare = 0.05;    // of it in as much time as has passed, for steps that start suddenly
constexpr double kRefinedShare = 0.25;  // of it where it had to be refined, for what is sudden later
constexpr double kLittle = 1.0 / 6.0;   // of its share: after such a change the next may be twice as long

constexpr double kJumpTime = 1e-6;    // a jump that is off stays so: it heats for so long  [s]
constexpr double kLeastRange = 0.01;  // of T_melt: what a tolerance is a part of where a layer starts near melting
constexpr int kMostHalvings = 22;
constexpr int kMostAttempts = 1024;  // of one step of a lane: then it takes the rest as it comes,
constexpr int kHurriedPieces = 64;   // in about so many

// What a lane's substep answered: a part of TileOutputs.
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

// `share` of the step after what `sum` holds. The host of a force-driven step exchanges momentum with the mean stress;
// velocity-driven it is told that at the end.
void add(const Answer& next, double share, bool forced, Answer& sum) {
  sum.stress = forced ? sum.stress + share * next.stress : next.stress;
  sum.slip += share * next.slip;
  sum.T0 = next.T0;
  sum.jump_new = next.jump_new;
  sum.heat += next.heat;
  sum.regime = next.regime;
  sum.outcome |= next.outcome;
}

// A step of one lane on its way.
struct Progress {
  int level = 0;        // tried next: dt / 2^level, against two halves of it
  std::int64_t at = 0;  // where that begins, in units of the shortest substep
  Answer sum;           // so far
  Answer coarse;        // of the next in one piece, where that is known
  bool coarse_known = true;
  bool refined = false;  // it is shorter than the one before it because of that one's change
  int attempts = 0;
  double left = 0.0;      // of what the step may change
  double estimate = 0.0;  // what it has changed
};

// By how much a jump is off after a substep from `before` to `after` in which it turns or stops: as one stress acts in
// it from the start on, all pieces it is halved into may be off alike, so that no halving tells. Until it turns the
// jump falls by A + 2 b s per substep, from then on it rises by A; taken to change by A throughout, it ends so much too
// far. Where it seems to stop and the far stresses are more than slip has carried, it may be anywhere below what it
// was.
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

// Each lane goes through its step in substeps of its own: one is accepted if two halves of it answer the same but for
// its share of the tolerance, else its first half is tried; where they differ by little the next is twice as long.
// Lanes whose next substeps are as long are solved together, those of the shortest first, so that they meet again. What
// a lane does depends on its own step alone.
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
      for (const int l : lanes_of(together)) judge(l);
    }
  }

 private:
  // The whole step in one piece.
  void begin() {
    const std::size_t stress = problem_.layout.shear_stress;
    advance_(problem_, operators_, inputs_, committed_, trial_, outputs_);
    now_.stress_before = nullptr;  // from here on the state's own
    std::copy_n(committed_, problem_.layout.doubles, accepted_);
    for (const int l : lanes_of(open_)) {
      lanes_[l].coarse = answer_of(outputs_, l);
      lanes_[l].left = kStepShare * *problem_.options.tolerance;
      if (inputs_.stress_before) accepted_[stress + static_cast<std::size_t>(l)] = inputs_.stress_before[l];
    }
  }

  // The next substep of some lanes in one piece, where that is not known yet, and in two.
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

  void judge(int l) {
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
    const double change = change_of(l, one, two, of_rest);
    const double share = lane.left * std::max(of_rest, kEarlyShare * of_past);
    const double allowed = lane.refined ? std::max(share, kRefinedShare * lane.left) : share;
    const bool hurries = ++lane.attempts > kMostAttempts;
    if (change > allowed && lane.level + 1 < deepest_ && !hurries) {
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
    lane.estimate += change;
    // What could not be kept sets the measure for the rest.
    lane.left = change > allowed ? std::max(lane.left, change) : lane.left - change;
    lane.at += length;
    lane.coarse_known = false;
    lane.refined = false;
    const bool fits = lane.level > 0 && lane.at % (2 * length) == 0;
    if (fits && (hurries ? end_ - lane.at > kHurriedPieces * length : change <= kLittle * share)) --lane.level;
    if (lane.at == end_) take(l);
  }

  // How far one piece is from two, as what it makes T0 off at the end of the step, in parts of what it has to melting:
  // T0 itself, of whose error diffusion leaves ever less; the heat released, which shows in T0 when it has left
  // melting; and the host's new jump, which goes on heating. `of_rest`: the piece of what the step has left.
  double change_of(int l, const Answer& one, const Answer& two, double of_rest) const {
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

  // What the substeps add up to, as the answer of the one step that the host asked for.
  void take(int l) {
    const Answer& sum = lanes_[l].sum;
    open_ &= ~(1u << l);
    copy_lane(accepted_, trial_, problem_.layout.doubles, l);
    trial_[problem_.layout.shear_stress + static_cast<std::size_t>(l)] = sum.stress;
    outputs_.error_estimate[l] = lanes_[l].estimate;
    outputs_.shear_stress[l] = sum.stress;
    // Where the slip reverses its mean could oppose the stress; friction does no negative work.
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

  TileInputs now_;                  // of what comes next
  TileOutputs first_{}, second_{};  // of the halves solved last
  const Problem& problem_;
  const StepOperators& operators_;
  const AdvanceTile advance_;  // one substep
  const TileInputs& inputs_;
  const double* committed_;
  double* trial_;
  TileOutputs& outputs_;
  const std::int64_t end_;  // of the step, in units of its shortest substep
  const double response_;   // B0 of the whole step
  double* const accepted_;  // state after the substeps accepted so far
  double* const half_;      // state after the first half of the next substep
  double* const fine_;      // state after both halves
  Progress lanes_[kLanes];
  const int deepest_;
  std::uint32_t open_;  // lanes on their way
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
