#include "server/physics/solver/around/sleep.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>

#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/force_driven/interface_step.hpp"
#include "server/physics/solver/velocity_driven/elastic_trial.hpp"

namespace shearbus::physics {
namespace {

constexpr int kLeastStepsBeforeSleep = 16;
constexpr double kRoundingOfT = 1e-6;   // far above what a temperature in modes is off  [K]
constexpr double kSurely = 1.0 - 1e-9;  // likewise a flow stress

int living(const TileLayout& layout, const double* tile, int lane) {
  return static_cast<int>(tile[layout.resting + kLanes + lane]);
}

// The layer of a lane that is no weaker anywhere: as hot as its hottest vertex, as little strained as its least
// strained. Without source heat only evens out, and who does not flow does not harden, so that while it sleeps it stays
// that.
struct WeakestVertex {
  double temperature;  // [K]
  double strength;     // before softening, at rest: a rate only adds  [Pa]
};

WeakestVertex weakest_vertex(const Problem& problem, const double* tile, int lane) {
  const TileLayout& layout = problem.layout;
  const double* T = tile + layout.first_temperature() + lane;
  const double* strain = tile + layout.plastic_strain + lane;
  double hottest = T[0], least = strain[0];
  for (std::ptrdiff_t i = 1; i < problem.heat_grid.num_vertices(); ++i) hottest = std::max(hottest, T[i * kLanes]);
  for (std::ptrdiff_t i = 1; i < problem.grid.num_vertices(); ++i) least = std::min(least, strain[i * kLanes]);
  return {hottest, hardened_strength(problem.options.soft, least)};
}

// Whether no vertex can flow under a stress magnitude, rounding included. `soft`: at the pressure.
bool surely_rigid(const Material& soft, double pressure, double stress, const WeakestVertex& weakest) {
  const double g = softening(soft, pressure, weakest.temperature + kRoundingOfT).g;
  return kSqrt3 * stress <= kSurely * (weakest.strength * g);
}

// Interface slip, whose starting stress is that of a layer at yield.
bool starts_at_yield(const Problem& problem, const TileInputs& inputs, int lane) {
  return problem.options.strategy == Strategy::kVelocityDriven && problem.options.drive == Drive::kInterfaceSlip &&
         inputs.velocity_jump[lane] != 0.0;
}

std::optional<LaneStep> driven_at_rest(const Problem& problem, const TileInputs& inputs, const double* committed,
                                       const Material& soft, double dt, int lane) {
  const double jump = inputs.velocity_jump[lane];
  const double pressure = inputs.pressure[lane];
  if (pressure <= 0.0) return LaneStep{0.0, jump, jump, 0.0, Regime::kOpen, false, true, false};
  const ElasticTrial trial =
      elastic_trial(problem, soft, inputs, lane, dt, stress_before(problem.layout, inputs, committed, lane));
  const std::optional<double> mu = problem.options.friction_coefficient;
  if (trial.heats() || starts_at_yield(problem, inputs, lane) || (mu && *mu * pressure < std::abs(trial.stress)))
    return std::nullopt;
  // A zero with the sign that it has where the layer is solved.
  const double slip = problem.options.drive == Drive::kLayerShear ? std::copysign(0.0, trial.direction) : 0.0;
  return LaneStep{trial.stress, slip, jump, 0.0, Regime::kStick, true, true, false};
}

// The step of a lane that sleeps, where no heat comes with it and the layer does not flow; nothing where it has to
// wake.
std::optional<LaneStep> step_at_rest(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                     const double* committed, const Material& soft, double T0, int lane) {
  const TileLayout& layout = problem.layout;
  std::optional<LaneStep> step;
  if (problem.options.strategy == Strategy::kVelocityDriven) {
    step = driven_at_rest(problem, inputs, committed, soft, operators.dt(), lane);
  } else {
    const HeatOperator& heat = operators.heat();
    step = InterfaceStep(problem, inputs, committed, soft, lane)
               .from(InterfaceStep::before(layout, inputs, committed, lane), heat.dt, *heat.layer_response(), T0);
    if (!step->unique || step->flux != 0.0 || !(step->regime == Regime::kOpen || step->sticks)) return std::nullopt;
  }
  if (step && step->regime != Regime::kOpen && layout.weakest != TileLayout::kAbsent) {
    const WeakestVertex weakest{committed[layout.weakest + lane], committed[layout.weakest + kLanes + lane]};
    if (!surely_rigid(soft, inputs.pressure[lane], std::abs(step->stress), weakest)) return std::nullopt;
  }
  return step;
}

// Whether the step that was solved brought neither heat nor flow, in a way that step_at_rest could have told.
bool rested(const Problem& problem, const TileInputs& inputs, const TileOutputs& outputs, int lane) {
  if (outputs.friction_heat[lane] != 0.0 || (outputs.outcome[lane] & ~kOutsideDomain) != 0) return false;
  const Regime regime = outputs.regime[lane];
  return regime == Regime::kOpen || (regime == Regime::kStick && !starts_at_yield(problem, inputs, lane));
}

// The committed states of a tile in which sleepers that wake have their temperatures again.
class Woken {
 public:
  const double* tile(const Problem& problem, std::uint32_t waking, const double* committed) {
    const TileLayout& layout = problem.layout;
    std::copy_n(committed, layout.doubles, states_.data());
    for (const int l : lanes_of(waking)) profile_of(problem, committed, l, states_.data() + layout.first_temperature());
    return states_.data();
  }

 private:
  static constexpr std::size_t kOtherRows = 9;
  // Temperatures, strain, heat shape.
  std::array<double, (std::size_t{3} * kMaxBasisVertices + kOtherRows) * kLanes> states_;
};

[[gnu::noinline]] void advance_woken(const Problem& problem, const StepOperators& operators, AdvanceTile awake,
                                     const TileInputs& inputs, std::uint32_t waking, const double* committed,
                                     double* trial, TileOutputs& outputs) {
  Woken woken;
  awake(problem, operators, inputs, woken.tile(problem, waking, committed), trial, outputs);
}

void write_sleeper(const Problem& problem, const double* committed, const LaneStep& step, double T0, int num_live,
                   int lane, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  trial[layout.shear_stress + lane] = step.stress;
  trial[layout.regime + lane] = static_cast<double>(step.regime);
  if (layout.sticking != TileLayout::kAbsent) trial[layout.sticking + lane] = step.sticks ? 1.0 : 0.0;
  trial[layout.resting + lane] = committed[layout.resting + lane] + 1.0;
  trial[layout.resting + kLanes + lane] = num_live;
  outputs.shear_stress[lane] = step.stress;
  outputs.sliding_velocity[lane] = step.slip;
  outputs.interface_temperature[lane] = T0;
  outputs.velocity_jump_new[lane] = step.jump_new;
  outputs.friction_heat[lane] = 0.0;
  outputs.regime[lane] = step.regime;
  outputs.outcome[lane] = kAsleep;
  if (problem.options.strategy == Strategy::kVelocityDriven)
    outputs.outcome[lane] |= outside_domain(step.slip, step.jump_new);
}

// Counts the steps at rest of a lane that was solved, and puts it to sleep after enough of them. One of which it is not
// certain that it would not flow is looked at again after as many.
void count_rest(const Problem& problem, const TileInputs& inputs, const double* committed, const Material& soft,
                int lane, double* trial, const TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const double before = asleep(layout, committed, lane) ? 0.0 : committed[layout.resting + lane];
  const double steps = rested(problem, inputs, outputs, lane) ? before + 1.0 : 0.0;
  WeakestVertex weakest{};
  bool sleeps = steps >= problem.steps_before_sleep;
  if (sleeps && layout.weakest != TileLayout::kAbsent) {
    weakest = weakest_vertex(problem, trial, lane);
    sleeps = outputs.regime[lane] == Regime::kOpen ||
             surely_rigid(soft, inputs.pressure[lane], std::abs(outputs.shear_stress[lane]), weakest);
  }
  trial[layout.resting + lane] = sleeps || steps < problem.steps_before_sleep ? steps : 0.0;
  trial[layout.resting + kLanes + lane] =
      sleeps ? to_modes(*problem.basis, lane, trial + layout.first_temperature()) : 0.0;
  if (layout.weakest == TileLayout::kAbsent) return;
  trial[layout.weakest + lane] = sleeps ? weakest.temperature : 0.0;
  trial[layout.weakest + kLanes + lane] = sleeps ? weakest.strength : 0.0;
}

}  // namespace

int steps_before_sleep(int num_heat_vertices) {
  return std::max(kLeastStepsBeforeSleep, num_heat_vertices / 4);
}

double interface_temperature(const Problem& problem, const double* tile, int lane) {
  const TileLayout& layout = problem.layout;
  if (!asleep(layout, tile, lane)) return tile[layout.temperature + lane];
  const double* amplitude = tile + layout.first_temperature() + lane;
  double T0 = 0.0;
  for (std::ptrdiff_t k = living(layout, tile, lane); k-- > 0;)
    T0 += problem.basis->at_interface[static_cast<std::size_t>(k)] * amplitude[k * kLanes];
  return T0;
}

void profile_of(const Problem& problem, const double* tile, int lane, double* temperature) {
  const TileLayout& layout = problem.layout;
  const double* rows = tile + layout.first_temperature();
  if (asleep(layout, tile, lane)) {
    to_profile(*problem.basis, living(layout, tile, lane), lane, rows, temperature);
    return;
  }
  copy_lane(rows, temperature, static_cast<std::size_t>(problem.heat_grid.num_vertices()) * kLanes, lane);
}

void advance_with_sleep(const Problem& problem, const StepOperators& operators, AdvanceTile awake,
                        const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const HeatBasis& basis = *problem.basis;
  const double* decay = operators.decay();
  const double* rows = committed + layout.first_temperature();
  double* rows_new = trial + layout.first_temperature();

  // 1. Who sleeps, and what the interface temperatures of the sleepers will be.
  std::uint32_t sleeping = 0;
  int num_live = 0;
  for (const int l : lanes_of(inputs.active)) {
    if (!asleep(layout, committed, l)) continue;
    sleeping |= 1u << l;
    num_live = std::max(num_live, living(layout, committed, l));
  }
  double T0[kLanes];
  if (sleeping != 0) interface_later(basis, decay, num_live, rows, T0);

  // 2. Who goes on sleeping.
  LaneStep at_rest[kLanes];
  std::uint32_t resting = 0;
  const LaneMaterials soft_at(problem.options.soft, inputs);
  for (const int l : lanes_of(sleeping)) {
    const auto step = step_at_rest(problem, operators, inputs, committed, soft_at(l), T0[l], l);
    if (!step) continue;
    at_rest[l] = *step;
    resting |= 1u << l;
  }

  // 3. The others are solved.
  const std::uint32_t solved = inputs.active & ~resting;
  if (solved != 0) {
    TileInputs others = inputs;
    others.active = solved;
    if (const std::uint32_t waking = sleeping & solved; waking != 0) {
      advance_woken(problem, operators, awake, others, waking, committed, trial, outputs);
    } else {
      awake(problem, operators, others, committed, trial, outputs);
    }
    for (const int l : lanes_of(solved)) count_rest(problem, inputs, committed, soft_at(l), l, trial, outputs);
  }
  if (resting == 0) return;

  // 4. The sleepers' heat, and the rest of their states, which stays as it is.
  if (solved == 0) {
    const auto behind = static_cast<std::ptrdiff_t>(layout.temperature + layout.num_vertices * kLanes);
    std::copy_n(committed + behind, static_cast<std::ptrdiff_t>(layout.doubles) - behind, trial + behind);
    decay_modes(decay, num_live, basis.num_modes(), rows, rows_new);
  }
  for (const int l : lanes_of(resting)) {
    if (solved != 0) {
      copy_lane(committed, trial, layout.doubles, l);
      for (std::ptrdiff_t k = 0; k < basis.num_modes(); ++k) rows_new[k * kLanes + l] *= decay[k];
    }
    const int lives = still_living(living(layout, committed, l), l, rows_new);
    write_sleeper(problem, committed, at_rest[l], T0[l], lives, l, trial, outputs);
  }
}

}  // namespace shearbus::physics
