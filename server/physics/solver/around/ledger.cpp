#include "server/physics/solver/around/ledger.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "server/physics/material/strength.hpp"
#include "server/physics/solver/around/sleep.hpp"
#include "server/physics/solver/around/varying_heat.hpp"

namespace shearbus::physics {
namespace {

// Adds factor (now - before) at one vertex to `sum`, lane by lane.
void add_change(LaneValues& sum, double factor, const double* before, const double* now, int vertex) {
  const std::ptrdiff_t first = std::ptrdiff_t{vertex} * kLanes;
  for (int lane = 0; lane < kLanes; ++lane) sum[lane] += factor * (now[first + lane] - before[first + lane]);
}

// The plastic slip of the layer in the step: sqrt(3) times the integral of the strain increment over z  [m].
LaneValues plastic_slip(const Problem& problem, const double* ep_old, const double* ep_new) {
  LaneValues sum{};
  for (int i = 0; i < problem.grid.num_vertices(); ++i)
    add_change(sum, problem.grid.weight[static_cast<std::size_t>(i)], ep_old, ep_new, i);
  for (double& slip : sum) slip *= kSqrt3;
  return sum;
}

// The velocity at which a stress component does work, with that of the soft body's shear in the host  [m/s].
double working_velocity(const ModelOptions& options, double jump, double jump_new, double shear_rate,
                        double plastic_strain_rate) {
  const double h = options.grid.thickness;
  if (options.strategy == Strategy::kVelocityDriven)
    return options.drive == Drive::kInterfaceSlip ? jump + h * shear_rate : jump;
  const double mean = 0.5 * (jump + jump_new);
  return options.plastic_layer ? mean + kSqrt3 * h * plastic_strain_rate : mean;
}

// Share of the plastic work that does not become heat.
double cold_share(const ModelOptions& options) {
  if (options.strategy == Strategy::kForceDriven) return 1.0 - options.taylor_quinney_factor.value_or(0.0);
  if (options.drive == Drive::kInterfaceSlip) return 1.0;  // the heat is the work of the jump, not that of the flow
  return 1.0 - options.taylor_quinney_factor.value_or(1.0);
}

// The growth of the heat where c follows the temperature, by its mean between both ends.
StoredHeat stored_by_temperature(const Problem& problem, const double* T_old, const double* T_new) {
  StoredHeat stored;
  const Material &soft = problem.options.soft, &hard = problem.options.hard;
  for (int lane = 0; lane < kLanes; ++lane) {
    const HeatGrid grid = grid_between(problem, T_old + lane, T_new + lane);
    for (int i = 0; i < grid.num_vertices(); ++i) {
      const auto vertex = static_cast<std::size_t>(i);
      const std::size_t place = vertex * kLanes + static_cast<std::size_t>(lane);
      const double rise = T_new[place] - T_old[place];
      const double in_soft = i < grid.interface ? 0.0 : soft.conductivity / soft.diffusivity * grid.weight[vertex];
      stored.soft[static_cast<std::size_t>(lane)] += in_soft * rise;
      stored.hard[static_cast<std::size_t>(lane)] += (grid.capacity(i, soft, hard) - in_soft) * rise;
    }
  }
  return stored;
}

}  // namespace

StoredHeat stored_in_rows(const Problem& problem, const double* T_old, const double* T_new, const double* entered) {
  StoredHeat stored;
  if (problem.modes) {
    // Modes in place of a temperature profile: a slab holds all its heat in the mode of rate 0, which is the row 1; a
    // half-space loses no heat, so it stores what entered.
    const HeatModes& modes = *problem.modes;
    if (modes.rate.front() > 0.0) {
      std::copy_n(entered, kLanes, stored.soft.begin());
    } else {
      add_change(stored.soft, 1.0 / modes.weight.front(), T_old, T_new, 1);
    }
    return stored;
  }
  if (problem.heat_varies) return stored_by_temperature(problem, T_old, T_new);
  const HeatGrid& grid = problem.heat_grid;
  const Material& soft = problem.options.soft;
  const Material& hard = problem.options.hard;
  for (int i = 0; i < grid.interface; ++i) add_change(stored.hard, grid.capacity(i, soft, hard), T_old, T_new, i);
  // The vertex at z = 0 belongs to both bodies; without a conducting hard body, hard_weight is 0.
  const double weight = grid.weight[static_cast<std::size_t>(grid.interface)];
  add_change(stored.soft, soft.conductivity / soft.diffusivity * weight, T_old, T_new, grid.interface);
  add_change(stored.hard, hard.conductivity / hard.diffusivity * grid.hard_weight, T_old, T_new, grid.interface);
  for (int i = grid.interface + 1; i < grid.num_vertices(); ++i)
    add_change(stored.soft, grid.capacity(i, soft, hard), T_old, T_new, i);
  return stored;
}

void Model::record_energy(const StepOperators& operators, const TileInputs& inputs, const TileOutputs& outputs,
                          const double* committed, const double* trial, TileLedger& ledger) const {
  const Problem& problem = *problem_;
  const TileLayout& layout = problem.layout;
  const ModelOptions& options = problem.options;
  const double spring = options.strategy == Strategy::kVelocityDriven
                            ? 0.5 * options.grid.thickness / options.soft.shear_modulus
                            : 0.0;  // the force-driven balance, DLP (64), has no elastic shear of the layer
  const StoredHeat stored = stored_heat(problem, committed, trial, outputs.friction_heat);
  const LaneValues plastic_slips =
      layout.plastic_strain == TileLayout::kAbsent
          ? LaneValues{}
          : plastic_slip(problem, committed + layout.plastic_strain, trial + layout.plastic_strain);
  for (const int lane : lanes_of(inputs.active)) {
    const bool failed = (outputs.outcome[lane] & kFailed) != 0;  // a node whose step failed keeps its state: no work
    const double s_old = committed[layout.shear_stress + lane];
    const double s = trial[layout.shear_stress + lane];
    double size = s;  // two tangential components: magnitude of the stress; one: the signed stress
    double power = s * working_velocity(options, inputs.velocity_jump[lane], outputs.velocity_jump_new[lane],
                                        inputs.soft_shear_rate[lane], inputs.soft_plastic_strain_rate[lane]);
    double elastic = spring * (s - s_old) * (s + s_old);
    if (options.tangential_components == 2) {
      const double t_old = committed[layout.second_stress + lane];
      const double t = trial[layout.second_stress + lane];
      size = std::hypot(s, t);
      power += t * working_velocity(options, inputs.second_velocity_jump[lane], outputs.second_velocity_jump_new[lane],
                                    0.0, inputs.second_soft_plastic_strain_rate[lane]);
      elastic += spring * (t - t_old) * (t + t_old);
    }
    const double work = failed ? 0.0 : power * operators.dt();
    const double plastic = std::abs(size) * plastic_slips[lane];
    const double heat = outputs.friction_heat[lane];

    // If only the soft body is resolved, the bodies receive fixed shares of the friction heat; if both are resolved,
    // each receives the heat that it has gained.
    const bool two_sided = options.hard_grid.has_value();
    const double to_soft = two_sided ? stored.soft[lane] : heat;
    const double to_hard = two_sided ? stored.hard[lane] : heat * (1.0 / problem.heat_partition - 1.0);
    ledger(LedgerTerm::kWork, lane) = work;
    ledger(LedgerTerm::kHeatToSoft, lane) = to_soft;
    ledger(LedgerTerm::kHeatToHard, lane) = to_hard;
    ledger(LedgerTerm::kPlasticWork, lane) = plastic;
    ledger(LedgerTerm::kStoredSoft, lane) = stored.soft[lane];
    ledger(LedgerTerm::kStoredHard, lane) = stored.hard[lane];
    ledger(LedgerTerm::kElastic, lane) = elastic;
    ledger(LedgerTerm::kHeatResidual, lane) = heat - stored.soft[lane] - stored.hard[lane];
    ledger(LedgerTerm::kEnergyResidual, lane) = work - to_soft - to_hard - cold_share(options) * plastic - elastic;
  }
}

}  // namespace shearbus::physics
