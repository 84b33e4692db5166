#include "server/physics/solver/force_driven/stages.hpp"

#include <cmath>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/force_driven/step.hpp"
#include "server/physics/solver/force_driven/wide_slip.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/sdirk2.hpp"
#include "server/physics/solver/step_operators.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

using sdirk2::begin_second_stage;
using sdirk2::kDiagonal;
using sdirk2::kFirstWeight;
using sdirk2::lanes_out_of_range;

constexpr double kMet = 1e-9;  // largest accepted |stress of a slipping interface - its limit|, relative to the stress

// The lanes (nodes) of which every vertex stays below melting under the flux. The second stage starts from extrapolated
// temperatures, so the hottest vertex may lie inside the layer.
std::uint32_t lanes_that_stay_solid(const HeatOperator& stage, int /*num_rows*/, const double (&flux)[kLanes],
                                    const double (&T_melt)[kLanes], const double* T_ad) {
  return lanes_below(stage.response, flux, T_melt, T_ad);
}
std::uint32_t lanes_that_stay_solid(const ModeOperator& step, int num_rows, const double (&flux)[kLanes],
                                    const double (&T_melt)[kLanes], const double* rows) {
  return lanes_below({&step.response, 1}, flux, T_melt, rows + (std::ptrdiff_t{num_rows} - 1) * kLanes);
}

// One lane of a second-order force-driven step. Stresses and velocities are positive along `direction`.
struct StagedLane {
  StressLimit limit;
  Forcing forcing;
  double direction;  // sign of the jump or, without a jump, sign of the acceleration
  double jump_old;   // jump before the step, along `direction`  [m/s]
  bool at_rest = false;
  double early_stress = 0.0;  // stress of the first stage  [Pa]
  double stress = 0.0;        // mean stress of the step  [Pa]
  double slip = 0.0;          // mean of the velocity jumps before and after the step  [m/s]
};

double free_jump(const StagedLane& lane, double dt) {
  return lane.jump_old + dt * lane.direction * lane.forcing.acceleration;
}

// The searches for the stresses of a stage, and their answers: whether the interface sticks, and whether it has one
// answer.
struct StageSearches {
  LaneSearch lane[kLanes];
  std::uint32_t wanted = 0;  // lanes that have a search
  std::uint32_t stick = 0, unique = 0;

  void solve() {
    const std::uint32_t found = wide_stress(lane, wanted);
    for (const int l : lanes_of(wanted)) {
      auto& [limit, heating, a_stick, guess, stress] = lane[l];
      bool sticks = stress == a_stick, one_answer = true;
      if (!contains(found, l)) {
        sticks = spare_strength(limit, heating, a_stick) >= 0.0;
        one_answer = sticks || slip_is_unique(limit, heating, a_stick);
        stress = sticks || !one_answer ? a_stick : slip_stress(limit, heating, a_stick, guess);
      }
      if (sticks) stick |= 1u << l;
      if (one_answer) unique |= 1u << l;
    }
  }
};

// First stage: stress and heat flux at the time gamma dt, from the velocity jump at that time. Returns false if the
// jump reverses or stops within the step: backward Euler then takes the step. Leaves the search to `searches`.
bool begin_first_stage(const StagedLane& lane, double heat_partition, double B0, double T_ad, double dt, double dt_step,
                       double guess, int l, StageSearches& searches) {
  if (lane.limit.pressure <= 0.0) return true;
  const double free = free_jump(lane, dt);
  if (free < 0.0 || free_jump(lane, dt_step) < 0.0) return false;
  const FrictionHeating heating{T_ad, heat_partition * B0, free, dt * lane.forcing.mobility};
  searches.lane[l] = {lane.limit, heating, free / heating.b, guess, 0.0};
  searches.wanted |= 1u << l;
  return true;
}
// Returns false if the node stops within the step, or if the answer is not unique.
bool end_first_stage(StagedLane& lane, double heat_partition, int l, const StageSearches& searches, double& flux) {
  lane.early_stress = searches.lane[l].stress;
  if (contains(searches.stick, l)) {
    lane.at_rest = lane.jump_old == 0.0;
    return lane.at_rest;
  }
  if (!contains(searches.unique, l)) return false;
  flux = heat_partition * (lane.early_stress * searches.lane[l].heating.slip(lane.early_stress));
  return true;
}

// Second stage: the mean stress a of the step, in which the first stage's stress has the weight 1 - gamma:
//   a = (1 - gamma) s1 + gamma s_lim(T0),   (1 - gamma) q1 + gamma q = beta_T a [V]mid
// so that the heat of the step is the friction work of the step, as in a backward Euler step. Returns false if a node
// at rest does not stay so.
bool begin_second_stage_of(StagedLane& lane, double heat_partition, double B0, double T_ad, double dt,
                           double early_flux, int l, StageSearches& searches) {
  const double free = free_jump(lane, dt);
  if (lane.limit.pressure <= 0.0) {
    lane.slip = 0.5 * (lane.jump_old + free);
    return true;
  }
  if (lane.at_rest) {
    lane.stress = lane.early_stress;
    return lane.limit.at(T_ad).stress >= lane.stress;
  }
  searches.lane[l] = {lane.limit.scaled(kDiagonal, kFirstWeight * lane.early_stress),
                      {T_ad - B0 * (kFirstWeight / kDiagonal) * early_flux, heat_partition * B0 / kDiagonal,
                       0.5 * (lane.jump_old + free), 0.5 * dt * lane.forcing.mobility},
                      free / (dt * lane.forcing.mobility),
                      lane.early_stress,
                      0.0};
  searches.wanted |= 1u << l;
  return true;
}
bool end_second_stage(StagedLane& lane, double heat_partition, double B0, double T_ad, double early_flux, int l,
                      const StageSearches& searches, double& flux) {
  if (contains(searches.stick, l) || !contains(searches.unique, l)) return false;
  const LaneSearch& search = searches.lane[l];
  const double a = search.stress;
  lane.stress = a;
  lane.slip = search.heating.slip(a);
  flux = (heat_partition * (a * lane.slip) - kFirstWeight * early_flux) / kDiagonal;
  const double T0 = T_ad + B0 * flux;
  return flux >= 0.0 && std::abs(search.limit.at(T0).stress - a) <= kMet * a;
}

template <class Heat>
void advance(const Problem& problem, const StepOperators& operators, const Heat& first, const Heat& second,
             const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const int n = problem.heat_rows;
  const double dt = operators.dt();
  const double* T_old = committed + layout.first_temperature();
  double* T = trial + layout.first_temperature();
  const double* T0 = trial + layout.temperature;
  std::uint32_t solved = inputs.active;
  const auto drop = [&](int lane) { solved &= ~(1u << lane); };

  // 1. First stage: conduction, then stress and flux lane by lane.
  StagedLane lanes[kLanes];
  const LaneMaterials soft(problem.options.soft, inputs);
  double early_flux[kLanes] = {};
  StageSearches early;
  conduct(first, n, T_old, T);
  for (const int l : lanes_of(solved)) {
    add_work(inputs, l, 2.0 * (n + kSearchWork));
    const double jump = inputs.velocity_jump[l];
    StagedLane& lane = lanes[l];
    lane.limit = interface_strength(problem.interface, soft(l), inputs.pressure[l], inputs.effort);
    lane.forcing = forcing_of(inputs, l);
    lane.direction = (jump != 0.0 ? jump : lane.forcing.acceleration) < 0.0 ? -1.0 : 1.0;
    lane.jump_old = lane.direction * jump;
    if (!begin_first_stage(lane, problem.heat_partition, *first.layer_response(), T0[l], first.dt, dt,
                           std::abs(stress_before(layout, inputs, committed, l)), l, early))
      drop(l);
  }
  early.solve();
  for (const int l : lanes_of(early.wanted)) {
    if (!end_first_stage(lanes[l], problem.heat_partition, l, early, early_flux[l])) drop(l);
  }
  add_flux(first, n, early_flux, T);

  // 2. Second stage. It starts from temperatures extrapolated from the old ones and those of the first stage.
  begin_second_stage(second, n, T_old, early_flux, T);
  solved &= ~lanes_out_of_range(problem, inputs, T_old, T);
  double flux[kLanes] = {};
  double T_melt[kLanes];
  for (int l = 0; l < kLanes; ++l) T_melt[l] = soft(l).melting_temperature;
  const double B0 = *second.layer_response();
  StageSearches late;
  for (const int l : lanes_of(solved)) {
    if (!begin_second_stage_of(lanes[l], problem.heat_partition, B0, T0[l], dt, early_flux[l], l, late)) drop(l);
  }
  late.solve();
  for (const int l : lanes_of(late.wanted)) {
    if (!end_second_stage(lanes[l], problem.heat_partition, B0, T0[l], early_flux[l], l, late, flux[l])) drop(l);
  }
  solved &= lanes_that_stay_solid(second, n, flux, T_melt, T);
  for (int l = 0; l < kLanes; ++l) flux[l] = contains(solved, l) ? flux[l] : 0.0;

  add_flux(second, n, flux, T);

  // 3. Backward Euler for the active lanes to which SDIRK2 does not apply.
  if (const std::uint32_t fallen_back = inputs.active & ~solved; fallen_back != 0) {
    TileInputs theirs = inputs;
    theirs.active = fallen_back;
    double* fallback = scratch_tile(Scratch::kStages, layout.doubles);
    advance_force_driven(problem, operators, theirs, committed, fallback, outputs);
    for (const int l : lanes_of(fallen_back)) {
      copy_lane(fallback, trial, layout.doubles, l);
      // Marks the step as one of first order. A node that sticks at the end of the step is not marked, because the
      // order in time of its step does not matter.
      if (outputs.regime[l] != Regime::kStick) outputs.outcome[l] |= kFirstOrder;
    }
  }

  // 4. Write the answers of the solved lanes.
  for (const int l : lanes_of(solved)) {
    const StagedLane& lane = lanes[l];
    const bool open = inputs.pressure[l] <= 0.0;
    outputs.shear_stress[l] = lane.direction * lane.stress;
    outputs.sliding_velocity[l] = lane.direction * lane.slip;
    outputs.velocity_jump_new[l] =
        lane.at_rest ? 0.0 : lane.direction * (free_jump(lane, dt) - lane.stress * (dt * lane.forcing.mobility));
    outputs.friction_heat[l] = dt * (kFirstWeight * early_flux[l] + kDiagonal * flux[l]);
    outputs.interface_temperature[l] = T0[l];
    outputs.regime[l] = open           ? Regime::kOpen
                        : lane.at_rest ? Regime::kStick
                                       : slip_regime(lane.limit, T0[l], lane.slip);
    outputs.outcome[l] = 0;
    trial[layout.shear_stress + l] = outputs.shear_stress[l];
    trial[layout.regime + l] = static_cast<double>(outputs.regime[l]);
  }
}

}  // namespace

void advance_force_driven_sdirk2(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                 const double* committed, double* trial, TileOutputs& outputs) {
  if (problem.modes) {
    const StepOperators::ModeStages& stages = operators.mode_stages();
    advance(problem, operators, stages.first, stages.second, inputs, committed, trial, outputs);
  } else {
    advance(problem, operators, operators.stage(), operators.stage(), inputs, committed, trial, outputs);
  }
}

}  // namespace shearbus::physics
