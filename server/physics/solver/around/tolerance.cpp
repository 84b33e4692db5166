#include "server/physics/solver/around/tolerance.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "server/physics/layer/modes.hpp"
#include "server/physics/material/strength.hpp"
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

constexpr int kMostHalvings = 22;  // largest number of times that a step is halved
// Largest number of substeps tried in one step of a lane; the rest is then accepted whatever its estimated error.
constexpr int kMostAttempts = 1024;
constexpr int kHurriedPieces = 64;  // approximate number of substeps that follow after kMostAttempts

constexpr double kLeastRelaxation = 1e-9;  // smallest fall of the stress, relative, that counts as a relaxation

SubstepAnswer answer_of(const TileOutputs& out, int l) {
  return {out.shear_stress[l],
          out.sliding_velocity[l],
          out.interface_temperature[l],
          out.velocity_jump_new[l],
          out.friction_heat[l],
          out.mean_shear_stress[l],
          out.regime[l],
          out.outcome[l]};
}

// Adds a substep, whose length is the fraction `share` of the step, to the answer of the substeps before it. The
// force-driven answer is the mean stress, with which the host exchanges momentum; the velocity-driven answer is the
// stress at the end.
void add(const SubstepAnswer& next, double share, bool forced, SubstepAnswer& sum) {
  sum.stress = forced ? sum.stress + share * next.stress : next.stress;
  sum.slip += share * next.slip;
  sum.T0 = next.T0;
  sum.jump_new = next.jump_new;
  sum.heat += next.heat;
  sum.regime = next.regime;
  sum.outcome |= next.outcome;
}

}  // namespace

ControlledStep::ControlledStep(const Problem& problem, const StepOperators& operators, AdvanceTile advance,
                               AdvanceTile first_order, const TileInputs& inputs, const double* committed,
                               double* trial, TileOutputs& outputs, double* accepted)
    : now_(inputs),
      problem_(problem),
      operators_(operators),
      advance_(advance),
      first_order_(first_order),
      inputs_(inputs),
      committed_(committed),
      trial_(trial),
      outputs_(outputs),
      end_(std::int64_t{1} << operators.most_times_halved()),
      errors_(problem, inputs, operators.dt(),
              problem.modes ? operators.modes().response : operators.heat().layer_response()[0]),
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
    const std::uint32_t divided = solve(level, together);
    for (const int l : lanes_of(divided)) accept_or_refine(l);
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

// Solves the whole step of all active lanes in one piece, by backward Euler if the model has both orders.
void ControlledStep::begin() {
  const std::size_t stress = problem_.layout.shear_stress;
  begun_ = true;
  std::copy_n(committed_, problem_.layout.doubles, accepted_);
  std::copy_n(committed_, problem_.layout.doubles, trial_);  // for the lanes that are not active
  TileOutputs piece{};
  (first_order_ != nullptr ? first_order_ : advance_)(problem_, operators_, now_, committed_, half_, piece);
  now_.stress_before = nullptr;  // null: a substep takes its initial stress from the accepted state
  for (const int l : lanes_of(open_)) {
    lanes_[l].left = kStepShare * *problem_.options.tolerance;
    if (inputs_.stress_before) accepted_[stress + static_cast<std::size_t>(l)] = inputs_.stress_before[l];
    if ((piece.outcome[l] & kAsleep) != 0) {
      accept_piece(l, piece, 0.0);
    } else if (first_order_ != nullptr) {
      take_first_order(l, piece);
    } else {
      lanes_[l].coarse = answer_of(piece, l);
      lanes_[l].coarse_known = true;
    }
  }
  relax(piece);
}

// The pressure of the host's step holds from its start. If it has fallen, a stress at the yield stress of the step
// before lies above that of this step, and relaxes to it at once. A layer that is unloaded in addition passes the new
// yield stress within picoseconds: no substep of the usual length would flow, and none would show the error. The
// shortest substep, without a jump, does the relaxation. `piece`: the step in one piece.
void ControlledStep::relax(const TileOutputs& piece) {
  if (forced_) return;
  now_.active = 0;
  const double* stress = accepted_ + problem_.layout.shear_stress;
  for (const int l : lanes_of(open_)) {
    const bool falls = std::abs(piece.shear_stress[l]) < std::abs(stress[l]) || piece.shear_stress[l] * stress[l] < 0.0;
    // Of a jump that is slip and turns the stress before is no part of the step, which starts at the yield stress.
    const bool starts_anew = jump_is_slip(problem_.options) && now_.velocity_jump[l] * stress[l] < 0.0;
    if (falls && !starts_anew) now_.active |= 1u << l;
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
    lanes_[l].first_order_known = false;
  }
}

// The heat flux that leaves z = 0 into the bodies, from the temperatures on either side of it  [W/m2].
double ControlledStep::flux_of(int l) const {
  const HeatGrid& grid = problem_.heat_grid;
  const auto at = static_cast<std::size_t>(grid.interface);
  const double* T = accepted_ + problem_.layout.first_temperature() + l;
  const double T0 = T[at * kLanes];
  double flux = problem_.options.soft.conductivity * (T0 - T[(at + 1) * kLanes]) / grid.width[at];
  if (at > 0) flux += problem_.options.hard.conductivity * (T0 - T[(at - 1) * kLanes]) / grid.width[at - 1];
  return flux;
}

// The stress at which the layer of a lane begins to flow along its jump; 0 where it has no temperatures  [Pa].
double ControlledStep::yield_of(int l) const {
  const TileLayout& layout = problem_.layout;
  if (problem_.basis && asleep(layout, accepted_, l)) return 0.0;
  const double pressure = inputs_.pressure[l];
  const Material soft = at_pressure(problem_.options.soft, pressure);
  double least = std::numeric_limits<double>::infinity(), last_strain = -1.0, last_T = 0.0;
  for (std::size_t i = static_cast<std::size_t>(l); i < layout.num_strain_vertices * kLanes; i += kLanes) {
    const double strain = accepted_[layout.plastic_strain + i], T = accepted_[layout.temperature + i];
    if (strain != last_strain || T != last_T) least = std::min(least, flow_stress(soft, strain, pressure, T));
    last_strain = strain;
    last_T = T;
  }
  return std::copysign(least / kSqrt3, now_.velocity_jump[l]);
}

// What shared the jump of a lane before its next substep.
Sharing ControlledStep::sharing_of(int l) const {
  const TileLayout& layout = problem_.layout;
  if (!forced_ || !problem_.options.plastic_layer) return Sharing::kUnknown;
  if (accepted_[layout.sticking + l] != 0.0) return Sharing::kFlow;
  const auto regime = static_cast<Regime>(static_cast<int>(accepted_[layout.regime + l]));
  if (regime == Regime::kOpen) return Sharing::kUnknown;
  return regime == Regime::kCoulomb ? Sharing::kFriction : Sharing::kYield;
}

// The next substep of a lane, for the estimates of its error.
Substep ControlledStep::substep_of(int l) const {
  const auto lane = static_cast<std::size_t>(l);
  const std::int64_t length = end_ >> lanes_[l].level;
  return {.lane = l,
          .length = std::ldexp(1.0, -lanes_[l].level),
          .of_rest = static_cast<double>(length) / static_cast<double>(end_ - lanes_[l].at),
          .velocity_jump = now_.velocity_jump[l],
          .stress_before = accepted_[problem_.layout.shear_stress + lane],
          .T0_before = interface_temperature(problem_, accepted_, l),
          .flowed = lanes_[l].at > 0 &&
                    accepted_[problem_.layout.regime + lane] > static_cast<double>(Regime::kStick) &&
                    accepted_[problem_.layout.shear_stress + lane] * now_.velocity_jump[l] > 0.0,
          .flux_before = first_order_ != nullptr ? flux_of(l) : 0.0,
          .before = sharing_of(l)};
}

// Share of the error budget that the next substep of a lane may use because of its length.
double ControlledStep::share_of(int l) const {
  const std::int64_t length = end_ >> lanes_[l].level;
  const double of_rest = static_cast<double>(length) / static_cast<double>(end_ - lanes_[l].at);
  const double of_past = static_cast<double>(length) / static_cast<double>(lanes_[l].at + length);
  return lanes_[l].left * std::max(of_rest, kEarlyShare * of_past);
}

// The next substep of a lane by backward Euler is in half_: accepts it, or keeps the answer for the estimate of the
// error of second order. A step is tried that way once, at its start.
void ControlledStep::take_first_order(int l, const TileOutputs& piece) {
  Progress& lane = lanes_[l];
  lane.first_order = answer_of(piece, l);
  lane.first_order_known = true;
  const double error = errors_.of_first_order(substep_of(l), lane.first_order);
  if (error <= share_of(l) && (lane.first_order.outcome & kFailed) == 0) accept_piece(l, piece, error);
}

// The next substep of a lane, solved in one piece, is in half_ and accurate enough.
void ControlledStep::accept_piece(int l, const TileOutputs& piece, double error) {
  const double length = std::ldexp(1.0, -lanes_[l].level);
  copy_lane(half_, accepted_, problem_.layout.doubles, l);
  add(answer_of(piece, l), length, forced_, lanes_[l].sum);
  lanes_[l].awake |= (piece.outcome[l] & kAsleep) == 0;
  if (forced_) now_.velocity_jump[l] = piece.velocity_jump_new[l];
  if (inputs_.wants_mean_stress) lanes_[l].mean_stress += length * piece.mean_shear_stress[l];
  move_on(l, error);
}

// Solves the next substep of the lanes `together` in one piece, unless that answer is known or second order already
// failed, and in two halves, unless one piece is accurate enough. Returns the lanes solved in two halves.
std::uint32_t ControlledStep::solve(int level, std::uint32_t together) {
  now_.active = 0;
  for (const int l : lanes_of(together)) {
    if (!lanes_[l].coarse_known) now_.active |= 1u << l;
  }
  if (now_.active != 0) {
    TileOutputs piece{};
    advance_(problem_, operators_.halved(level), now_, accepted_, half_, piece);
    for (const int l : lanes_of(now_.active)) {
      Progress& lane = lanes_[l];
      lane.coarse = answer_of(piece, l);
      if ((lane.coarse.outcome & kAsleep) != 0) {  // a step at rest has no error
        together &= ~(1u << l);
        accept_piece(l, piece, 0.0);
        continue;
      }
      if (!lane.first_order_known || (lane.coarse.outcome & kFailed) != 0) continue;
      lane.first_order_known = false;
      const double error = errors_.of_piece(substep_of(l), lane.coarse, lane.first_order);
      if (!(error <= share_of(l))) continue;
      together &= ~(1u << l);
      accept_piece(l, piece, error);
    }
  }
  if (together == 0) return 0;
  const StepOperators& halves = operators_.halved(level + 1);
  now_.active = together;
  advance_(problem_, halves, now_, accepted_, half_, first_);
  TileInputs then = now_;
  if (forced_) std::copy_n(first_.velocity_jump_new, kLanes, then.velocity_jump);
  advance_(problem_, halves, then, half_, fine_, second_);
  return together;
}

void ControlledStep::accept_or_refine(int l) {
  Progress& lane = lanes_[l];
  const SubstepAnswer halves[] = {answer_of(first_, l), answer_of(second_, l)};
  if (((halves[0].outcome | halves[1].outcome) & kFailed) != 0) return give_up(l, kFailed);
  Substep substep = substep_of(l);
  if (errors_.flows_on(substep, lane.coarse, halves)) substep.yield_before = yield_of(l);
  const double error = errors_.of_halves(substep, lane.coarse, halves);
  const double share = share_of(l);
  const double allowed = lane.refined ? std::max(share, kRefinedShare * lane.left) : share;
  const bool hurries = ++lane.attempts > kMostAttempts;
  if (error > allowed && lane.level + 1 < deepest_ && !hurries) {
    ++lane.level;
    lane.coarse = halves[0];
    lane.coarse_known = true;
    lane.refined = true;
    return;
  }
  copy_lane(fine_, accepted_, problem_.layout.doubles, l);
  const double half = std::ldexp(0.5, -lane.level);
  for (const SubstepAnswer& answer : halves) add(answer, half, forced_, lane.sum);
  if (forced_) {
    const double more = errors_.impulse_left(substep, lane.coarse, halves);
    lane.sum.stress += 2.0 * half * more;
    lane.sum.jump_new = now_.velocity_jump[l] = errors_.jump_after(substep, halves[1].jump_new, more);
  }
  lane.awake = true;
  if (inputs_.wants_mean_stress && !forced_)
    lane.mean_stress += 2.0 * half * errors_.mean_stress(substep, lane.coarse, halves);
  move_on(l, error);
}

// Goes on behind an accepted substep of a lane.
void ControlledStep::move_on(int l, double error) {
  Progress& lane = lanes_[l];
  const std::int64_t length = end_ >> lane.level;
  const double share = share_of(l);
  const double allowed = lane.refined ? std::max(share, kRefinedShare * lane.left) : share;
  const bool hurries = lane.attempts > kMostAttempts;
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

// The sum of the substeps becomes the answer of the host's step.
void ControlledStep::finish(int l) {
  const SubstepAnswer& sum = lanes_[l].sum;
  open_ &= ~(1u << l);
  copy_lane(accepted_, trial_, problem_.layout.doubles, l);
  double& stress = trial_[problem_.layout.shear_stress + static_cast<std::size_t>(l)];
  // The search of the next step starts from the stress and its rate: from the mean stress it is three times as far to the
  // end of the next step as to the end of this one.
  if (forced_ && problem_.options.plastic_layer)
    trial_[problem_.layout.stress_rate + l] = 3.0 * (std::abs(stress) - std::abs(sum.stress)) / operators_.dt();
  stress = sum.stress;
  outputs_.error_estimate[l] = lanes_[l].estimate;
  outputs_.shear_stress[l] = sum.stress;
  if (inputs_.wants_mean_stress) outputs_.mean_shear_stress[l] = lanes_[l].mean_stress;
  // The mean slip could oppose the mean stress where the slip reverses; friction does no negative work.
  outputs_.sliding_velocity[l] = sum.stress * sum.slip < 0.0 ? 0.0 : sum.slip;
  outputs_.interface_temperature[l] = sum.T0;
  outputs_.velocity_jump_new[l] = sum.jump_new;
  outputs_.friction_heat[l] = sum.heat;
  outputs_.regime[l] = sum.regime;
  outputs_.outcome[l] = lanes_[l].awake ? sum.outcome & static_cast<std::uint8_t>(~kAsleep) : sum.outcome;
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
