#include "server/physics/solver/around/tolerance.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "server/physics/layer/modes.hpp"
#include "server/physics/solver/around/sleep.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/work.hpp"

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

constexpr double kLeastRelaxation = 1e-9;  // smallest fall of the stress, relative, that counts as a relaxation

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

// What a half of a velocity-driven substep did, for elastic_path_error().
struct ElasticPath {
  double stress, heat;
  bool along_jump, flows;
};

// Error of the heat of the two halves of a velocity-driven substep, each of length dt. The elastic part of the path of
// the stress, along which the stress changes by G0 |w| / h per time, is only a part of a half if the stress passes zero
// or reaches the flow stress there. Both halves may miss that part, so comparing them does not show its error.
// `s_old`: stress before the first half. A rise that goes on at the same rate in the second half is hardening.
double elastic_path_error(double heating, double rate, double dt, double s_old, const ElasticPath (&halves)[2]) {
  double error = 0.0, s = s_old;
  for (int i = 0; i < 2; ++i) {
    const ElasticPath& half = halves[i];
    const bool turns = s * half.stress < 0.0;
    double rise = std::abs(half.stress) - (turns ? 0.0 : std::abs(s));
    if (i == 0 && !turns) rise -= std::max(0.0, std::abs(halves[1].stress) - std::abs(half.stress));
    const bool meets_flow = half.flows && (i == 0 || !halves[0].flows);
    s = half.stress;
    if (!half.along_jump || !(rise > 0.0) || !(turns || meets_flow)) continue;
    const double while_rising = 0.5 * rise * rise / rate;  // of the time integral of the stress  [Pa s]
    if (!turns) {
      error += heating * while_rising;
      continue;
    }
    const double before = i == 0 ? s_old : halves[0].stress;
    const double after_turning = std::max(0.0, dt - std::abs(before) / rate);
    error += std::abs(half.heat - heating * (std::abs(half.stress) * after_turning - while_rising));
  }
  return error;
}

}  // namespace

ControlledStep::ControlledStep(const Problem& problem, const StepOperators& operators, AdvanceTile advance,
                               const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs,
                               double* accepted)
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
      accepted_(accepted),
      deepest_(operators.most_times_halved()),
      open_(inputs.active),
      forced_(problem.options.strategy == Strategy::kForceDriven) {
  now_.work = work_;
}

bool ControlledStep::run(double work) {
  half_ = scratch_tile(Scratch::kFirstHalf, problem_.layout.doubles);
  fine_ = scratch_tile(Scratch::kSecondHalf, problem_.layout.doubles);
  const double until = work_done() + work;
  if (!begun_) begin();
  while (open_ != 0) {
    if (work_done() > until) return false;
    int level = 0;
    for (const int l : lanes_of(open_)) level = std::max(level, lanes_[l].level);
    std::uint32_t together = 0;
    for (const int l : lanes_of(open_)) {
      if (lanes_[l].level == level) together |= 1u << l;
    }
    solve(level, together);
    for (const int l : lanes_of(together)) accept_or_refine(l);
    for (const int l : lanes_of(together & open_)) {
      if (work_[l] > problem_.options.work_budget) give_up(l, kFailed | kOverBudget);
    }
  }
  for (const int l : lanes_of(inputs_.active)) add_work(inputs_, l, work_[l]);
  return true;
}

double ControlledStep::work_done() const {
  double sum = 0.0;
  for (const double work : work_) sum += work;
  return sum;
}

// The lane ends without an answer.
void ControlledStep::give_up(int l, std::uint8_t outcome) {
  open_ &= ~(1u << l);
  keep_lane(problem_, inputs_, committed_, trial_, l, outputs_);
  outputs_.outcome[l] = outcome;
  outputs_.error_estimate[l] = 0.0;
}

ControlledStep::Answer ControlledStep::answer_of(const TileOutputs& out, int l) {
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
void ControlledStep::add(const Answer& next, double share, bool forced, Answer& sum) {
  sum.stress = forced ? sum.stress + share * next.stress : next.stress;
  sum.slip += share * next.slip;
  sum.T0 = next.T0;
  sum.jump_new = next.jump_new;
  sum.heat += next.heat;
  sum.regime = next.regime;
  sum.outcome |= next.outcome;
}

// Solves the whole step of all active lanes in one piece.
void ControlledStep::begin() {
  const std::size_t stress = problem_.layout.shear_stress;
  begun_ = true;
  advance_(problem_, operators_, now_, committed_, trial_, outputs_);
  now_.stress_before = nullptr;  // null: a substep takes its initial stress from the accepted state
  std::copy_n(committed_, problem_.layout.doubles, accepted_);
  for (const int l : lanes_of(open_)) {
    lanes_[l].coarse = answer_of(outputs_, l);
    lanes_[l].left = kStepShare * *problem_.options.tolerance;
    if (inputs_.stress_before) accepted_[stress + static_cast<std::size_t>(l)] = inputs_.stress_before[l];
  }
  relax();
}

// The pressure of the host's step holds from its start. If it has fallen, a stress at the yield stress of the step
// before lies above that of this step, and relaxes to it at once. A layer that is unloaded in addition passes the new
// yield stress within picoseconds: no substep of the usual length would flow, and none would show the error. The
// shortest substep, without a jump, does the relaxation.
void ControlledStep::relax() {
  if (forced_) return;
  now_.active = 0;
  const double* stress = accepted_ + problem_.layout.shear_stress;
  for (const int l : lanes_of(open_)) {
    const bool falls =
        std::abs(lanes_[l].coarse.stress) < std::abs(stress[l]) || lanes_[l].coarse.stress * stress[l] < 0.0;
    if (falls) now_.active |= 1u << l;
  }
  if (now_.active == 0) return;
  TileInputs still = now_;
  std::fill_n(still.velocity_jump, kLanes, 0.0);
  std::fill_n(still.soft_shear_rate, kLanes, 0.0);
  TileOutputs relaxed{};
  advance_(problem_, operators_.halved(deepest_), still, accepted_, half_, relaxed);
  const std::size_t first = problem_.layout.first_temperature();
  const auto rows = static_cast<std::size_t>(problem_.heat_rows) * kLanes;
  for (const int l : lanes_of(now_.active)) {
    const bool flows = relaxed.regime[l] != Regime::kStick && relaxed.regime[l] != Regime::kOpen;
    const bool relaxes = std::abs(relaxed.shear_stress[l]) < (1.0 - kLeastRelaxation) * std::abs(stress[l]);
    if (!flows || !relaxes || (relaxed.outcome[l] & kFailed) != 0) continue;
    // The relaxation takes no time, so that no heat is conducted. A lane that slept has temperatures since it woke.
    if (!asleep(problem_.layout, accepted_, l)) copy_lane(accepted_ + first, half_ + first, rows, l);
    copy_lane(half_, accepted_, problem_.layout.doubles, l);
    lanes_[l].sum.slip = std::ldexp(relaxed.sliding_velocity[l], -deepest_);
    lanes_[l].coarse_known = false;
  }
}

// Solves the next substep of the lanes `together` in one piece, unless that answer is known, and in two halves.
void ControlledStep::solve(int level, std::uint32_t together) {
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

void ControlledStep::accept_or_refine(int l) {
  Progress& lane = lanes_[l];
  const Answer one = answer_of(first_, l), two = answer_of(second_, l);
  if (((one.outcome | two.outcome) & kFailed) != 0) return give_up(l, kFailed);
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
  if (inputs_.wants_mean_stress && !forced_)
    lane.mean_stress += half * (first_.mean_shear_stress[l] + second_.mean_shear_stress[l]);
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
double ControlledStep::error_of(int l, const Answer& one, const Answer& two, double of_rest) const {
  const Answer& coarse = lanes_[l].coarse;
  const double dt = operators_.dt();
  const double T0 = std::abs(two.T0 - coarse.T0) * (of_rest * std::sqrt(of_rest));
  double heat = response_ / dt * std::abs(one.heat + two.heat - coarse.heat);
  double jump = 0.0;
  if (!forced_ && problem_.options.drive == Drive::kLayerShear) {
    const double V = inputs_.velocity_jump[l];
    const double rate = problem_.options.soft.shear_modulus * std::abs(V) / problem_.options.grid.thickness;  // [Pa/s]
    const auto path = [&](const Answer& half) {
      return ElasticPath{half.stress, half.heat, half.stress * V > 0.0, half.regime != Regime::kStick};
    };
    heat += response_ / dt *
            elastic_path_error(problem_.heat_partition * std::abs(V), rate, std::ldexp(0.5 * dt, -lanes_[l].level),
                               accepted_[problem_.layout.shear_stress + static_cast<std::size_t>(l)],
                               {path(one), path(two)});
  }
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
void ControlledStep::finish(int l) {
  const Answer& sum = lanes_[l].sum;
  open_ &= ~(1u << l);
  copy_lane(accepted_, trial_, problem_.layout.doubles, l);
  trial_[problem_.layout.shear_stress + static_cast<std::size_t>(l)] = sum.stress;
  outputs_.error_estimate[l] = lanes_[l].estimate;
  outputs_.shear_stress[l] = sum.stress;
  if (inputs_.wants_mean_stress) outputs_.mean_shear_stress[l] = lanes_[l].mean_stress;
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

double hard_step_work(const Problem& problem) {
  constexpr double kUsualSums = 10.0;       // sums of the flow over the layer in one search
  constexpr double kSolvesOfAttempt = 2.5;  // a substep in two halves, and often in one piece
  const ModelOptions& options = problem.options;
  const bool flows = options.strategy == Strategy::kVelocityDriven || options.plastic_layer;
  const double search =
      flows ? kUsualSums * flow_work(options.soft.flow_law) * problem.grid.num_vertices() : kSearchWork;
  const double stages = options.time_integrator == TimeIntegrator::kSdirk2 ? 2.0 : 1.0;
  return (options.tolerance ? kMostAttempts * kSolvesOfAttempt : 1.0) * stages * (problem.heat_rows + search);
}

int most_times_halved(double dt) {
  const double shortest = kShortestControlledStep / HeatModes::kHalvingsCovered;
  return std::clamp(std::ilogb(dt / shortest), 1, kMostHalvings);
}

}  // namespace shearbus::physics
