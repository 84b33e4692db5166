// Running a row on a physics, and what is held against it.
#include "tests/study/stability.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs and invariants

namespace {

// From so many steps on one lane is looked at in each, in turn: the invariants cost more than the step.
constexpr int kManySteps = 2000;

// What a first step that melts takes in, to what backward Euler makes of it: exactly 2/sqrt(pi), which substeps and
// modes may come near; of second order up to 8 % more than exactly.
constexpr double kExactFirstStep = 1.1284;
constexpr double kSecondOrderFirstStep = 1.22;

// All that is held against one scene of a row.
class Judge {
 public:
  Judge(const Row& row, Rig& rig, Outcome& outcome) : row_(row), rig_(rig), outcome_(outcome), molten_(rig) {
    rig.inputs.effort = &effort_;
  }

  // After a step: `lane_` is told where it broke.
  void step(const Course& course) {
    const ModelOptions& options = rig_.model.options();
    take_most(outcome_.most, effort_);
    require_effort(effort_, rig_);
    effort_ = {};
    // Where the layer itself is heated its interface may be cold, and the bound says nothing.
    const bool bounded = !options.taylor_quinney_factor;
    if (bounded) molten_.step(rig_);
    for (int l = 0; l < kLanes; ++l) {
      lane_ = l;
      heat_[l] += rig_.outputs.friction_heat[l];
      divided_ = divided_ || (rig_.outputs.outcome[l] & kSubstepped) != 0;
      if (row_.steps < kManySteps || course.step % kLanes == l)
        require_invariants(rig_, l, course.dt, outcome_.figures);
      if (bounded) require_bounded_work(l);
      if (row_.steady) require_no_ringing(l);
    }
    lane_ = -1;
  }

  int lane() const { return lane_; }

 private:
  void require_bounded_work(int l) {
    const ModelOptions& options = rig_.model.options();
    const double first_step = options.time_integrator == TimeIntegrator::kSdirk2 ? kSecondOrderFirstStep
                              : divided_ || options.modes                        ? kExactFirstStep
                                                                                 : 1.0;
    const double bound = molten_.heat(l) * first_step;
    require(heat_[l] <= bound * (1 + 1e-9) + 1e-12, "friction heat {} J/m2 above the {} of a molten interface",
            heat_[l], bound);
    if (bound > 0.0) outcome_.bound_share = std::max(outcome_.bound_share, heat_[l] / bound);
  }

  void require_no_ringing(int l) {
    const Answered a = answered(rig_, l, rig_.operators->dt());
    // A layer with inertia may swing; its waves are held by their own laws.
    if (rig_.model.options().inertia) return;
    stress_[l].see(a.stress, std::abs(a.stress) + 1e6);
    jump_[l].see(a.jump_new, std::abs(a.jump_old) + 1e-6);
    require(!stress_[l].rings(), "s rings: {} Pa after {} Pa", a.stress, a.stress_old);
    require(!jump_[l].rings(), "[V] rings: {} m/s", a.jump_new);
  }

  const Row& row_;
  Rig& rig_;
  Outcome& outcome_;
  MoltenLayer molten_;
  SearchEffort effort_;
  double heat_[kLanes] = {};
  bool divided_ = false;
  Ringing stress_[kLanes], jump_[kLanes];
  int lane_ = -1;
};

}  // namespace

void take_most(SearchEffort& most, const SearchEffort& now) {
  most.layer_sums = std::max(most.layer_sums, now.layer_sums);
  most.limit_values = std::max(most.limit_values, now.limit_values);
  most.newton_steps = std::max(most.newton_steps, now.newton_steps);
  most.guarded_steps = std::max(most.guarded_steps, now.guarded_steps);
}

SearchEffort effort_bound(const ModelOptions& options, bool divided) {
  // A divided step takes up to 2 + 4 + ... + 64 substeps, a second-order one two stages and perhaps the first order's.
  const int solves = (divided ? 127 : 1) * (options.time_integrator == TimeIntegrator::kSdirk2 ? 3 : 1);
  // Beside a flowing layer two searches, to stick and to slip, of at most 300 values each: seldom more than 100 in all.
  return {.layer_sums = (options.plastic_layer ? 610 : 300) * solves,
          .limit_values = 60 * kLanes * solves,
          .newton_steps = 20000,
          .guarded_steps = kLanes};
}

void require_effort(const SearchEffort& step, const Rig& rig) {
  const bool divided = std::any_of(rig.outputs.outcome, rig.outputs.outcome + kLanes,
                                   [](std::uint8_t outcome) { return (outcome & kSubstepped) != 0; });
  const SearchEffort bound = effort_bound(rig.model.options(), divided);
  require(step.layer_sums <= bound.layer_sums, "{} sums over the layer in one step, at most {} expected",
          step.layer_sums, bound.layer_sums);
  require(step.limit_values <= bound.limit_values, "{} values of the limit in one step, at most {} expected",
          step.limit_values, bound.limit_values);
  require(step.newton_steps <= bound.newton_steps, "{} Newton steps in one step, at most {} expected",
          step.newton_steps, bound.newton_steps);
}

Outcome run(const Row& row, const Physics& physics, int most_steps) {
  Outcome outcome;
  const auto begin = std::chrono::steady_clock::now();
  const std::vector<ModelOptions> scenes = row.scenes(physics.options);
  if (scenes.empty()) return outcome;
  outcome.verdict = Verdict::kHeld;
  for (std::size_t scene = 0; scene < scenes.size(); ++scene) {
    Rig rig(scenes[scene]);
    Course course(rig, static_cast<int>(scene));
    if (row.start) row.start(course);
    Judge judge(row, rig, outcome);
    try {
      for (; course.step < std::min(row.steps, most_steps); ++course.step) {
        row.before_step(course);
        rig.step(course.dt);
        judge.step(course);
      }
    } catch (const Broken& broken) {
      outcome.verdict = Verdict::kBroken;
      outcome.reason = fmt::format("scene {}, step {}, lane {}: {}", scene, course.step, judge.lane(), broken.what());
      break;
    }
  }
  if (outcome.verdict == Verdict::kHeld && row.meets && !row.meets(physics.options, outcome.figures)) {
    outcome.verdict = Verdict::kBroken;
    outcome.reason = "the row has not met what it is for";
  }
  outcome.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return outcome;
}

void Ringing::see(double value, double size) {
  const double change = value - last_;
  const bool turns = seen_ > 1 && change * change_ < 0.0 && std::abs(change) >= kUndamped * std::abs(change_) &&
                     std::abs(change) > kFelt * size;
  turns_ = turns ? turns_ + 1 : 0;
  change_ = change;
  last_ = value;
  ++seen_;
}

MoltenLayer::MoltenLayer(const Rig& rig)
    : temperature_(static_cast<std::size_t>(rig.heat_grid().num_vertices()) * kLanes) {
  const TileLayout& layout = rig.model.layout();
  const auto from = rig.committed.begin();
  if (layout.heat_modes == TileLayout::kAbsent) {
    const auto first = static_cast<std::ptrdiff_t>(layout.first_temperature());
    std::copy_n(from + first, temperature_.size(), temperature_.begin());
    return;
  }
  for (std::size_t i = 0; i < temperature_.size(); ++i) {
    temperature_[i] = rig.committed[layout.heat_modes + i % kLanes];  // where it started
  }
}

void MoltenLayer::step(const Rig& rig) {
  const ModelOptions& options = rig.model.options();
  const double dt = rig.operators->dt();
  if (!heat_ || heat_->dt != dt) heat_.emplace(rig.heat_grid(), options.soft, options.hard, dt);
  const int n = rig.heat_grid().num_vertices();
  conduct(*heat_, n, temperature_.data(), temperature_.data());
  double flux[kLanes];
  for (int l = 0; l < kLanes; ++l) {
    const auto at = static_cast<std::size_t>(l);
    melting_[at] = std::max(melting_[at], at_pressure(options.soft, rig.inputs.pressure[l]).melting_temperature);
    const double T_ad = temperature_[static_cast<std::size_t>(heat_->interface) * kLanes + at];
    flux[l] = std::max(0.0, (melting_[at] - T_ad) / *heat_->layer_response());
    taken_[at] += flux[l] * dt;
  }
  add_flux(*heat_, n, flux, temperature_.data());
}

}  // namespace shearbus::study::stability
