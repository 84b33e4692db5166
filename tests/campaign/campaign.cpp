// Runs a row (load history) of the stability campaign on a physics (combination of options) and checks every step.
#include "tests/campaign/campaign.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs, invariants of tests/support

namespace {

// A load history with at least this many steps has the invariants of only one lane (node) checked in each step, in
// rotation, because checks of all lanes would take longer than the steps.
constexpr int kManySteps = 2000;

// Returns the factor by which a first step that melts the interface may take in more heat than MoltenLayer does in the
// same step. With a temperature profile MoltenLayer makes one step of backward Euler. The exact heat is larger by the
// factor 2/sqrt(pi) = 1.128, and substeps may come close to it. A second-order step takes in 8.23 % more than the exact
// heat. With modes, which respond exactly to a constant flux, MoltenLayer takes in only sqrt(pi)/2 times the heat of
// backward Euler.
double share_of_first_step(const ModelOptions& options, bool divided) {
  constexpr double kExact = 1.12838, kSecondOrder = 1.0823;
  const double of_one_step = options.modes ? kExact : 1.0;
  if (options.time_integrator == TimeIntegrator::kSdirk2) return kSecondOrder * kExact * of_one_step;
  return divided || options.tolerance ? kExact * of_one_step : 1.0;
}

// Checks every step of a load history (a row of the campaign) on one of its scenes.
class Judge {
 public:
  Judge(const Row& row, Rig& rig, Outcome& outcome) : row_(row), rig_(rig), outcome_(outcome), molten_(rig) {
    rig.inputs.effort = &effort_;
  }

  // Checks the lanes after a step. If a check throws, lane() is the lane that failed.
  void step(const Course& course) {
    const ModelOptions& options = rig_.model.options();
    take_most(outcome_.most, effort_);
    require_effort(effort_, rig_);
    effort_ = {};
    // MoltenLayer bounds the heat that enters at the interface. With a Taylor-Quinney factor a part of the work heats
    // the inside of the layer instead, so the bound does not apply.
    // A melt film takes up latent heat, too; MoltenLayer has constant k and c.
    const bool bounded = !options.taylor_quinney_factor && !options.melt_film && !conducts_by_temperature(options);
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
    const double bound = molten_.heat(l) * share_of_first_step(rig_.model.options(), divided_);
    require(heat_[l] <= bound * (1 + 1e-9) + 1e-12, "friction heat {} J/m2 above the {} of a molten interface",
            heat_[l], bound);
    if (bound > 0.0) outcome_.bound_share = std::max(outcome_.bound_share, heat_[l] / bound);
  }

  void require_no_ringing(int l) {
    const Answered a = answered(rig_, l, rig_.operators->dt());
    // A layer with inertia may oscillate; property tests check its waves. So may the elastic layer between a jump that is
    // imposed and friction that falls with slip: it sticks and slips.
    const ModelOptions& options = rig_.model.options();
    const bool falls = has_friction(options) && properties_of(options.interface.friction_law).falls_with_slip;
    if (options.inertia || (falls && options.strategy == Strategy::kVelocityDriven)) return;
    // Scale of the velocity jump [V]: |[V]| plus `least_jump`. Under a tolerance small jumps are less accurate, so the
    // scale is larger.
    const double least_jump = std::max(1e-6, options.tolerance.value_or(0.0));  // [m/s]
    stress_[l].see(a.stress, std::abs(a.stress) + 1e6);
    jump_[l].see(a.jump_new, std::abs(a.jump_old) + least_jump);
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
  most.wave_evaluations = std::max(most.wave_evaluations, now.wave_evaluations);
}

SearchEffort effort_bound(const ModelOptions& options, bool divided) {
  // Number of solves. A step that is divided because it has several solutions: the whole step and 2 + 4 + ... + 64
  // substeps, 127. A step under a tolerance: about 1,024 attempts of 3 solves each (a piece and its two halves), 3,072;
  // 4,096 leaves room for the division of long pieces. Second order: two stages and possibly a first-order step in
  // addition, 3 times as many.
  const int parts = options.tolerance ? 4096 : divided ? 127 : 1;
  // With k(T) or c(T) each lane is solved alone, and up to 9 times.
  const bool varies = conducts_by_temperature(options);
  const int solves = parts * (options.time_integrator == TimeIntegrator::kSdirk2 ? 3 : 1) * (varies ? 9 : 1);
  // An interface on a flowing layer needs two searches, one for stick and one for slip. Each search evaluates at most
  // 300 sums over the layer; both together seldom evaluate more than 100. Each slip that is tried has a search of its own
  // for the stress of the contact. A limit that falls with slip is searched from both ends.
  const bool falls = has_friction(options) && properties_of(options.interface.friction_law).falls_with_slip;
  // Work that heats in place asks for the waves, and with them for the limit, at each amount of heat that is tried.
  const int amounts = options.inertia && options.taylor_quinney_factor ? 30 : 1;
  // Under force a step asks for the waves at each slip that is tried, most of them far from its answer. Of a lane whose
  // Newton's method fails each solution takes some hundred evaluations.
  const bool forced_waves = options.inertia && options.strategy == Strategy::kForceDriven;
  // Where heat crosses a melting body within a step, the phases of its vertices change one after another.
  const int melting = options.melt_film ? kLanes * options.grid.cells / 4 : 1;
  return {.layer_sums = (options.plastic_layer ? 610 : 300) * solves * (varies ? kLanes : 1) * melting,
          .limit_values = (options.plastic_layer ? 60 * 200
                           : falls               ? 400
                           : options.melt_film   ? 200
                                                 : 60) *
                          kLanes * solves * amounts,
          .wave_evaluations = 20000 * (forced_waves  ? 25
                                       : amounts > 1 ? 5
                                                     : 1)};
}

void require_effort(const SearchEffort& step, const Rig& rig) {
  const bool divided = std::any_of(rig.outputs.outcome, rig.outputs.outcome + kLanes,
                                   [](std::uint8_t outcome) { return (outcome & kSubstepped) != 0; });
  const SearchEffort bound = effort_bound(rig.model.options(), divided);
  require(step.layer_sums <= bound.layer_sums, "{} sums over the layer in one step, at most {} expected",
          step.layer_sums, bound.layer_sums);
  require(step.limit_values <= bound.limit_values, "{} values of the limit in one step, at most {} expected",
          step.limit_values, bound.limit_values);
  require(step.wave_evaluations <= bound.wave_evaluations, "{} evaluations of waves in one step, at most {} expected",
          step.wave_evaluations, bound.wave_evaluations);
}

Outcome run(const Row& row, const Physics& physics, int most_steps) {
  Outcome outcome;
  const auto begin = std::chrono::steady_clock::now();
  const std::vector<ModelOptions> scenes = row.scenes(physics);
  if (scenes.empty()) return outcome;
  outcome.verdict = Verdict::kHeld;
  for (std::size_t scene = 0; scene < scenes.size(); ++scene) {
    Rig rig(scenes[scene]);
    Course course(rig, physics.host, static_cast<int>(scene));
    if (row.start) row.start(course);
    Judge judge(row, rig, outcome);
    try {
      for (; course.step < std::min(row.steps, most_steps); ++course.step) {
        row.before_step(course);
        course.dt = std::max(course.dt, shortest_step(scenes[scene]));
        rig.step(course.dt);
        judge.step(course);
      }
    } catch (const Broken& broken) {
      outcome.verdict = Verdict::kBroken;
      outcome.reason = fmt::format("scene {}, step {}, lane {}: {}", scene, course.step, judge.lane(), broken.what());
      break;
    }
  }
  if (outcome.verdict == Verdict::kHeld && row.missed) {
    outcome.reason = row.missed(outcome.figures);
    if (!outcome.reason.empty()) outcome.verdict = Verdict::kNotMet;
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

MoltenLayer::MoltenLayer(const Rig& rig) {
  const TileLayout& layout = rig.model.layout();
  const auto first = rig.committed.begin() + static_cast<std::ptrdiff_t>(layout.first_temperature());
  rows_.assign(first, first + static_cast<std::ptrdiff_t>(layout.temperature - layout.first_temperature() +
                                                          layout.num_vertices * kLanes));
}

void MoltenLayer::step(const Rig& rig) {
  if (rig.model.options().modes) {
    step_with(rig.operators->modes(), rig);
  } else {
    step_with(rig.operators->heat(), rig);
  }
}

template <class Operator>
void MoltenLayer::step_with(const Operator& heat, const Rig& rig) {
  const int n = static_cast<int>(rows_.size()) / kLanes;
  conduct(heat, n, rows_.data(), rows_.data());
  double flux[kLanes];
  for (int l = 0; l < kLanes; ++l) {
    const auto at = static_cast<std::size_t>(l);
    const double T_melt = at_pressure(rig.model.options().soft, rig.inputs.pressure[l]).melting_temperature;
    melting_[at] = std::max(melting_[at], T_melt);
    const double T_ad = rows_[static_cast<std::size_t>(heat.interface) * kLanes + at];
    flux[l] = std::max(0.0, (melting_[at] - T_ad) / *heat.layer_response());
    taken_[at] += flux[l] * heat.dt;
  }
  add_flux(heat, n, flux, rows_.data());
}

// ---- Course: the run of a load history (row) on one scene ----

Course::Course(Rig& on, const Host& of, int scene_number)
    : rig(on), host(of), draw(7001 + static_cast<std::uint64_t>(scene_number)), scene(scene_number), dt(of.dt) {
  const ModelOptions& options = rig.model.options();
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.pressure[l] = host.pressure;
    rig.inputs.mass_soft[l] = options.soft.density * host.half_zone_soft + mass_of_waves(options).soft;
    rig.inputs.mass_hard[l] = options.hard.density * host.half_zone_hard;
    rig.inputs.soft_shear_rate[l] = 1e5;
    rig.inputs.soft_plastic_strain_rate[l] = options.plastic_layer ? 1e5 : 0.0;
  }
}

bool Course::forced() const {
  return rig.model.options().strategy == Strategy::kForceDriven;
}

namespace {
std::pair<double, double> direction_of(const Course& c, int lane) {
  if (c.rig.model.options().tangential_components == 1) return {1.0, 0.0};
  const double angle = 0.8 * lane + 0.01 * c.step;
  return {std::cos(angle), std::sin(angle)};
}
}  // namespace

void Course::impose(int lane, double jump) {
  const auto [x, y] = direction_of(*this, lane);
  rig.inputs.velocity_jump[lane] = x * jump;
  rig.inputs.second_velocity_jump[lane] = y * jump;
}

void Course::impose_all(const std::array<double, kLanes>& jumps) {
  for (int l = 0; l < kLanes; ++l) impose(l, jumps[static_cast<std::size_t>(l)]);
}

void Course::push(int lane, double soft, double hard) {
  const auto [x, y] = direction_of(*this, lane);
  rig.inputs.stress_soft[lane] = x * soft;
  rig.inputs.second_stress_soft[lane] = y * soft;
  rig.inputs.stress_hard[lane] = x * hard;
  rig.inputs.second_stress_hard[lane] = y * hard;
}

void Course::go_on(int lane) {
  if (!forced() || step == 0) return;
  rig.inputs.velocity_jump[lane] = rig.outputs.velocity_jump_new[lane];
  rig.inputs.second_velocity_jump[lane] = rig.outputs.second_velocity_jump_new[lane];
}

}  // namespace shearbus::study::stability
