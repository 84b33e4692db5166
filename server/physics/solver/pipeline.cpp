#include "server/physics/solver/pipeline.hpp"

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "server/physics/solver/around/interface_frame.hpp"
#include "server/physics/solver/around/sleep.hpp"
#include "server/physics/solver/around/tolerance.hpp"
#include "server/physics/solver/around/varying_heat.hpp"
#include "server/physics/solver/melting/phase_change.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/sdirk2.hpp"

namespace shearbus::physics {
namespace {

// Whether not only open contacts take steps of second order.
bool all_is_second_order(const ModelOptions& options) {
  return options.time_integrator == TimeIntegrator::kSdirk2 && !only_open_is_second_order(options);
}

AdvanceTile solver_of(const ModelOptions& options) {
  const bool second_order = all_is_second_order(options);
  if (options.inertia) return second_order ? advance_with_inertia_sdirk2 : advance_with_inertia;
  if (options.strategy == Strategy::kVelocityDriven)
    return second_order ? advance_velocity_driven_sdirk2 : advance_velocity_driven;
  if (options.melt_film) return advance_force_driven_melting;
  if (options.plastic_layer) return advance_force_driven_flowing;
  return second_order ? advance_force_driven_sdirk2 : advance_force_driven;
}

StepAtRest* step_at_rest_of(const ModelOptions& options) {
  if (options.melt_film) return melting_step_at_rest;
  return options.strategy == Strategy::kVelocityDriven ? velocity_driven_step_at_rest : force_driven_step_at_rest;
}

// Writes 0 for each lane whose outputs are finite, else NaN. A plain loop, which vectorises.
void find_not_finite(const TileOutputs& outputs, double (&lost)[kLanes]) {
  const auto none = [](double x) { return x - x; };
  for (int l = 0; l < kLanes; ++l) {
    lost[l] = none(outputs.shear_stress[l]) + none(outputs.interface_temperature[l]) +
              none(outputs.sliding_velocity[l]) + none(outputs.velocity_jump_new[l]) + none(outputs.friction_heat[l]);
  }
}

// Gives the lanes without an answer their old state: no root was found, the arithmetic left the range of a double, or the
// old state was not finite. Copies the state of the lanes that are not active.
void keep_lost(const Problem& problem, const TileInputs& inputs, const double* committed, double* trial,
               TileOutputs& outputs) {
  double lost[kLanes], none_lost = 0.0;
  find_not_finite(outputs, lost);
  for (const double lane : lost) none_lost += lane;
  if (inputs.active == (1u << kLanes) - 1u && none_lost == 0.0) return;
  for (int lane = 0; lane < kLanes; ++lane) {
    if (!contains(inputs.active, lane)) {
      copy_lane(committed, trial, problem.layout.doubles, lane);
    } else if (lost[lane] != 0.0) {
      keep_lane(problem, inputs, committed, trial, lane, outputs);
    }
  }
}

// A step of an integrator of second order whose slip or flow is of first order: the solver's step, in which open
// contacts conduct to second order. A step that neither is open nor sticks has the outcome kFirstOrder.
void advance_open_to_second_order(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                  const double* committed, double* trial, TileOutputs& outputs) {
  solver_of(problem.options)(problem, operators, inputs, committed, trial, outputs);
  const TileLayout& layout = problem.layout;
  TileInputs open = inputs;
  open.active = 0;
  for (const int l : lanes_of(inputs.active)) {
    if ((outputs.outcome[l] & kFailed) != 0) continue;  // it has kept its state
    if (outputs.regime[l] != Regime::kOpen && outputs.regime[l] != Regime::kStick) outputs.outcome[l] |= kFirstOrder;
    const bool melts =
        problem.options.melt_film && (outputs.film_thickness[l] > 0.0 || film_thickness(problem, committed, l) > 0.0);
    if (outputs.regime[l] == Regime::kOpen && !melts) open.active |= 1u << l;
  }
  if (open.active == 0 || problem.modes) return;  // modes conduct without an error in time
  const double none[kLanes] = {};
  const std::size_t first = layout.first_temperature();
  double* rows = scratch_tile(Scratch::kStages, layout.doubles);
  conduct(operators.stage(), problem.heat_rows, committed + first, rows);
  sdirk2::begin_second_stage(operators.stage(), problem.heat_rows, committed + first, none, rows);
  const std::uint32_t out = sdirk2::lanes_out_of_range(problem, open, committed + first, rows);
  for (const int l : lanes_of(open.active)) {
    if (contains(out, l)) {
      outputs.outcome[l] |= kFirstOrder;
      continue;
    }
    copy_lane(rows, trial + first, static_cast<std::size_t>(problem.heat_rows) * kLanes, l);
    outputs.interface_temperature[l] = trial[layout.temperature + static_cast<std::size_t>(l)];
  }
}

AdvanceTile whole_solver_of(const ModelOptions& options) {
  const bool sdirk2 = options.time_integrator == TimeIntegrator::kSdirk2;
  return sdirk2 && only_open_is_second_order(options) ? advance_open_to_second_order : solver_of(options);
}

// Links 3 and 4 of the chain in pipeline.hpp: sleep, which steps the sleeping lanes by their modes, and the solver for
// all other lanes.
void advance_once(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                  const double* committed, double* trial, TileOutputs& outputs) {
  const AdvanceTile solve = whole_solver_of(problem.options);
  if (problem.heat_varies) {
    advance_varying(problem, operators.dt(), solve, inputs, committed, trial, outputs);
  } else if (problem.basis) {
    advance_with_sleep(problem, operators, solve, step_at_rest_of(problem.options), inputs, committed, trial, outputs);
  } else {
    solve(problem, operators, inputs, committed, trial, outputs);
  }
  keep_lost(problem, inputs, committed, trial, outputs);
}

void advance_first_order(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                         const double* committed, double* trial, TileOutputs& outputs) {
  advance_velocity_driven(problem, operators, inputs, committed, trial, outputs);
  keep_lost(problem, inputs, committed, trial, outputs);
}

// Backward Euler in place of a second-order step of the same layer, or null.
AdvanceTile first_order_of(const Problem& problem) {
  const ModelOptions& options = problem.options;
  const bool sheared = options.strategy == Strategy::kVelocityDriven && options.drive == Drive::kLayerShear;
  return sheared && all_is_second_order(options) && !problem.basis && !problem.heat_varies ? advance_first_order
                                                                                           : nullptr;
}

// The stress that a force-driven step answers is its mean already: the momentum balance (61) takes it as constant over
// the step, and that of substeps is their mean.
void answer_mean_stress(const Problem& problem, const TileInputs& inputs, TileOutputs& outputs) {
  if (!inputs.wants_mean_stress || problem.options.strategy != Strategy::kForceDriven) return;
  std::copy_n(outputs.shear_stress, kLanes, outputs.mean_shear_stress);
  if (problem.options.tangential_components == 2)
    std::copy_n(outputs.second_shear_stress, kLanes, outputs.second_mean_shear_stress);
}

// One step of a tile under a tolerance, which may be interrupted between two substeps: the first two links of the
// chain, frame and tolerance. All arguments must live until the step is done.
struct DividedTile {
  // `accepted_states`: memory of one tile.
  DividedTile(const Problem& problem_of_model, const StepOperators& operators, const TileInputs& tile,
              const double* committed, double* trial_states, TileOutputs& out, double* accepted_states)
      : problem(problem_of_model),
        inputs(tile),
        trial(trial_states),
        outputs(out),
        frame(problem, operators, inputs, committed),
        step(problem, operators, advance_once, first_order_of(problem), frame.inputs(), committed, trial, outputs,
             accepted_states) {}

  bool run(double work) {
    if (!step.run(work)) return false;
    frame.leave(trial, outputs);
    answer_mean_stress(problem, inputs, outputs);
    return true;
  }

  const Problem& problem;
  const TileInputs& inputs;
  double* trial;
  TileOutputs& outputs;
  InterfaceFrame frame;
  ControlledStep step;
};

}  // namespace

struct DividedStep::Impl {
  explicit Impl(const Problem& of) : problem(of), accepted(of.layout.doubles) {}
  const Problem& problem;
  std::vector<double> accepted;
  std::optional<DividedTile> step;
};

DividedStep::DividedStep(const Model& model) : impl_(std::make_unique<Impl>(*model.problem_)) {}
DividedStep::DividedStep(DividedStep&&) noexcept = default;
DividedStep::~DividedStep() = default;

void DividedStep::begin(const StepOperators& operators, const TileInputs& inputs, const double* committed,
                        double* trial, TileOutputs& outputs) {
  impl_->step.emplace(impl_->problem, operators, inputs, committed, trial, outputs, impl_->accepted.data());
}

bool DividedStep::run(double work) {
  return impl_->step->run(work);
}

void Model::advance(const StepOperators& operators, const TileInputs& inputs, const double* committed, double* trial,
                    TileOutputs& outputs) const {
  const Problem& problem = *problem_;
  if (problem.options.tolerance) {
    DividedTile(problem, operators, inputs, committed, trial, outputs,
                scratch_tile(Scratch::kAccepted, problem.layout.doubles))
        .run(std::numeric_limits<double>::infinity());
    return;
  }
  const InterfaceFrame frame(problem, operators, inputs, committed);
  advance_once(problem, operators, frame.inputs(), committed, trial, outputs);
  frame.leave(trial, outputs);
  answer_mean_stress(problem, inputs, outputs);
}

void advance_aside(AdvanceTile solve, const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                   std::uint32_t lanes, const double* committed, double* trial, TileOutputs& outputs) {
  if (lanes == 0) return;
  TileInputs theirs = inputs;
  theirs.active = lanes;
  double* aside = scratch_tile(Scratch::kStages, problem.layout.doubles);
  solve(problem, operators, theirs, committed, aside, outputs);
  for (const int l : lanes_of(lanes)) copy_lane(aside, trial, problem.layout.doubles, l);
}

void keep_lane(const Problem& problem, const TileInputs& inputs, const double* committed, double* trial, int lane,
               TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  copy_lane(committed, trial, layout.doubles, lane);
  const Regime regime = static_cast<Regime>(static_cast<int>(committed[layout.regime + lane]));
  write_answer(
      {{committed[layout.shear_stress + lane], 0.0, inputs.velocity_jump[lane], 0.0, regime}, 0.0, 0.0, kFailed},
      layout, lane, trial, outputs);
  if (inputs.wants_mean_stress) {
    outputs.mean_shear_stress[lane] = outputs.shear_stress[lane];
    const std::size_t far = (layout.num_stress_vertices - 1) * kLanes;  // 0 without inertia
    outputs.mean_far_stress[lane] = committed[layout.shear_stress + far + lane];
  }
  outputs.interface_temperature[lane] = interface_temperature(problem, committed, lane);
  if (problem.options.melt_film) outputs.film_thickness[lane] = film_thickness(problem, committed, lane);
}

double Model::interface_temperature(const double* tile, int lane) const {
  return physics::interface_temperature(*problem_, tile, lane);
}
}  // namespace shearbus::physics
