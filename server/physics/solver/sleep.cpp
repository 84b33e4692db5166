#include "server/physics/solver/sleep.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>

#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/solver/interface_step.hpp"

namespace shearbus::physics {
namespace {

constexpr int kLeastStepsBeforeSleep = 16;

int living(const TileLayout& layout, const double* tile, int lane) {
  return static_cast<int>(tile[layout.resting + kLanes + lane]);
}

// A strategy whose contact can stick without a profile to look at: the interface alone decides.
bool can_stick_asleep(const ModelOptions& options) {
  return options.strategy == Strategy::kForceDriven && !options.plastic_layer;
}

// The step of a lane that sleeps, where no heat comes with it; nothing where it has to wake.
std::optional<LaneStep> step_at_rest(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                     const double* committed, const Material& soft, double T0, int lane) {
  const double jump = inputs.velocity_jump[lane];
  if (problem.options.strategy == Strategy::kVelocityDriven) {
    if (inputs.pressure[lane] > 0.0) return std::nullopt;
    return LaneStep{0.0, jump, jump, 0.0, Regime::kOpen, false, true, false};
  }
  if (inputs.pressure[lane] > 0.0 && !can_stick_asleep(problem.options)) return std::nullopt;
  const HeatOperator& heat = operators.heat();
  const LaneStep step =
      InterfaceStep(problem, inputs, committed, soft, lane)
          .from(InterfaceStep::before(problem.layout, inputs, committed, lane), heat.dt, *heat.layer_response(), T0);
  const bool rests = step.unique && step.flux == 0.0 && (step.regime == Regime::kOpen || step.sticks);
  return rests ? std::optional(step) : std::nullopt;
}

// Whether the step that was solved brought no heat, in a way that step_at_rest could have told.
bool rested(const Problem& problem, const TileOutputs& outputs, int lane) {
  if (outputs.friction_heat[lane] != 0.0 || outputs.outcome[lane] != 0) return false;
  const Regime regime = outputs.regime[lane];
  return regime == Regime::kOpen || (regime == Regime::kStick && can_stick_asleep(problem.options));
}

// The committed states of a tile in which sleepers that wake have their temperatures again.
class Woken {
 public:
  const double* tile(const Problem& problem, std::uint32_t waking, const double* committed) {
    const TileLayout& layout = problem.layout;
    std::copy_n(committed, layout.doubles, states_.data());
    for (int l = 0; l < kLanes; ++l) {
      if (waking >> l & 1u) profile_of(problem, committed, l, states_.data() + layout.first_temperature());
    }
    return states_.data();
  }

 private:
  static constexpr std::size_t kOtherRows = 9;
  // Temperatures, strain, heat shape, shadow.
  std::array<double, (std::size_t{4} * kMaxBasisVertices + kOtherRows) * kLanes> states_;
};

[[gnu::noinline]] void advance_woken(const Problem& problem, const StepOperators& operators, AdvanceTile awake,
                                     const TileInputs& inputs, std::uint32_t waking, const double* committed,
                                     double* trial, TileOutputs& outputs) {
  Woken woken;
  awake(problem, operators, inputs, woken.tile(problem, waking, committed), trial, outputs);
}

void write_sleeper(const TileLayout& layout, const double* committed, const LaneStep& step, double T0, int num_live,
                   int lane, double* trial, TileOutputs& outputs) {
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
}

// The lane solved for heat beside its sleep, from where it fell asleep on: how far apart they are by now.
void step_shadow(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                 const double* committed, const Material& soft, int lane, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  double* temperature = trial + layout.shadow_temperature;
  conduct_lane(operators.heat(), problem.heat_grid.num_vertices(), lane, temperature);
  const double T0 = temperature[problem.heat_grid.interface * kLanes + lane];
  outputs.shadow_temperature_error[lane] = std::abs(T0 - outputs.interface_temperature[lane]);
  const auto step = step_at_rest(problem, operators, inputs, committed, soft, T0, lane);
  // One that would have moved differs by all the stress there is.
  outputs.shadow_stress_error[lane] = std::abs((step ? step->stress : 0.0) - outputs.shear_stress[lane]);
}

// Counts the steps at rest of a lane that was solved, and puts it to sleep after enough of them.
void count_rest(const Problem& problem, const double* committed, double* trial, int lane, const TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const double before = asleep(layout, committed, lane) ? 0.0 : committed[layout.resting + lane];
  const double steps = rested(problem, outputs, lane) ? before + 1.0 : 0.0;
  trial[layout.resting + lane] = steps;
  trial[layout.resting + kLanes + lane] = 0.0;
  if (layout.shadowed != TileLayout::kAbsent)  // the last parts of a tile, which no solver knows
    copy_lane(committed + layout.shadowed, trial + layout.shadowed, layout.doubles - layout.shadowed, lane);
  if (steps < problem.steps_before_sleep) return;
  if (layout.shadowed != TileLayout::kAbsent && trial[layout.shadowed + lane] != 0.0)
    profile_of(problem, trial, lane, trial + layout.shadow_temperature);
  trial[layout.resting + kLanes + lane] = to_modes(*problem.basis, lane, trial + layout.first_temperature());
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
  for (int l = 0; l < kLanes; ++l) {
    if (!(inputs.active >> l & 1u) || !asleep(layout, committed, l)) continue;
    sleeping |= 1u << l;
    num_live = std::max(num_live, living(layout, committed, l));
  }
  double T0[kLanes];
  if (sleeping != 0) interface_later(basis, decay, num_live, rows, T0);

  // 2. Who goes on sleeping.
  LaneStep at_rest[kLanes];
  std::uint32_t resting = 0;
  const LaneMaterials soft_at(problem.options.soft, inputs);
  for (int l = 0; l < kLanes; ++l) {
    if (!(sleeping >> l & 1u)) continue;
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
    for (int l = 0; l < kLanes; ++l) {
      if (solved >> l & 1u) count_rest(problem, committed, trial, l, outputs);
    }
  }
  if (resting == 0) return;

  // 4. The sleepers' heat, and the rest of their states, which stays as it is.
  if (solved == 0) {
    const auto behind = static_cast<std::ptrdiff_t>(layout.temperature + layout.num_vertices * kLanes);
    std::copy_n(committed + behind, static_cast<std::ptrdiff_t>(layout.doubles) - behind, trial + behind);
    decay_modes(decay, num_live, basis.num_modes(), rows, rows_new);
  }
  for (int l = 0; l < kLanes; ++l) {
    if (!(resting >> l & 1u)) continue;
    if (solved != 0) {
      copy_lane(committed, trial, layout.doubles, l);
      for (std::ptrdiff_t k = 0; k < basis.num_modes(); ++k) rows_new[k * kLanes + l] *= decay[k];
    }
    const int lives = still_living(living(layout, committed, l), l, rows_new);
    write_sleeper(layout, committed, at_rest[l], T0[l], lives, l, trial, outputs);
    if (layout.shadowed != TileLayout::kAbsent && committed[layout.shadowed + l] != 0.0)
      step_shadow(problem, operators, inputs, committed, soft_at(l), l, trial, outputs);
  }
}

}  // namespace shearbus::physics
