#include "server/physics/solver/around/ledger.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/around/sleep.hpp"

namespace shearbus::physics {
namespace {

using Lanes = std::array<double, kLanes>;

// sum += factor (now - before), lane by lane, at one vertex
void add_change(Lanes& sum, double factor, const double* before, const double* now, int vertex) {
  const std::ptrdiff_t first = std::ptrdiff_t{vertex} * kLanes;
  for (int lane = 0; lane < kLanes; ++lane) sum[lane] += factor * (now[first + lane] - before[first + lane]);
}

// What the bodies hold more than before  [J/m2].
struct Stored {
  Lanes soft{}, hard{};
};
Stored stored_in_rows(const Problem& problem, const double* T_old, const double* T_new, const double* entered) {
  Stored stored;
  if (problem.modes) {
    // Without a profile: a slab's mode of rate 0, behind the start temperature, holds all its heat; from a half-space
    // none returns.
    const HeatModes& modes = *problem.modes;
    if (modes.rate.front() > 0.0) {
      std::copy_n(entered, kLanes, stored.soft.begin());
    } else {
      add_change(stored.soft, 1.0 / modes.weight.front(), T_old, T_new, 1);
    }
    return stored;
  }
  const HeatGrid& grid = problem.heat_grid;
  const Material& soft = problem.options.soft;
  const Material& hard = problem.options.hard;
  for (int i = 0; i < grid.interface; ++i) add_change(stored.hard, grid.capacity(i, soft, hard), T_old, T_new, i);
  // Half of the vertex between them is the hard body's, where that conducts.
  const double weight = grid.weight[static_cast<std::size_t>(grid.interface)];
  add_change(stored.soft, soft.conductivity / soft.diffusivity * weight, T_old, T_new, grid.interface);
  add_change(stored.hard, hard.conductivity / hard.diffusivity * grid.hard_weight, T_old, T_new, grid.interface);
  for (int i = grid.interface + 1; i < grid.num_vertices(); ++i)
    add_change(stored.soft, grid.capacity(i, soft, hard), T_old, T_new, i);
  return stored;
}

// Heat of one lane above a uniform reference temperature.
struct Held {
  double soft, hard;
};
Held held_heat(const Problem& problem, const double* tile, int lane, double reference) {
  const HeatGrid& grid = problem.heat_grid;
  const double* rows = tile + problem.layout.first_temperature() + lane;
  Held held{};
  if (asleep(problem.layout, tile, lane)) {
    const HeatBasis& basis = *problem.basis;  // all but the first mode only share heat out
    if (!problem.options.hard_grid) return {basis.heat * (rows[0] - reference), 0.0};
    held.soft = basis.soft_heat[0] * (rows[0] - reference);
    for (std::ptrdiff_t k = 1; k < basis.num_modes(); ++k)
      held.soft += basis.soft_heat[static_cast<std::size_t>(k)] * rows[k * kLanes];
    held.hard = basis.heat * (rows[0] - reference) - held.soft;
    return held;
  }
  for (int i = 0; i < grid.num_vertices(); ++i) {
    const double heat =
        grid.capacity(i, problem.options.soft, problem.options.hard) * (rows[std::ptrdiff_t{i} * kLanes] - reference);
    const double in_soft = i < grid.interface ? 0.0 : i == grid.interface ? problem.soft_share_at_interface() : 1.0;
    held.soft += in_soft * heat;
    held.hard += (1.0 - in_soft) * heat;
  }
  return held;
}

// Where a lane is asleep before or after the step, its modes tell.
Stored stored_heat(const Problem& problem, const double* committed, const double* trial, const double* entered) {
  const TileLayout& layout = problem.layout;
  const std::size_t first = layout.first_temperature();
  int num_awake = 0;
  bool slept[kLanes], sleeps[kLanes];
  for (int l = 0; l < kLanes; ++l) {
    slept[l] = asleep(layout, committed, l);
    sleeps[l] = asleep(layout, trial, l);
    num_awake += slept[l] || sleeps[l] ? 0 : 1;
  }
  Stored stored;
  if (num_awake > 0) stored = stored_in_rows(problem, committed + first, trial + first, entered);
  for (int l = 0; l < kLanes; ++l) {
    if (!slept[l] && !sleeps[l]) continue;
    stored.soft[l] = stored.hard[l] = 0.0;
    if (slept[l] && sleeps[l] && !problem.options.hard_grid) continue;  // no heat comes or goes
    // Against the cold end of the profile, or the mean: small differences of small numbers.
    const double reference = (slept[l] ? committed : trial)[first + static_cast<std::size_t>(l)];
    const Held before = held_heat(problem, committed, l, reference);
    const Held after = held_heat(problem, trial, l, reference);
    stored.soft[l] = after.soft - before.soft;
    stored.hard[l] = after.hard - before.hard;
  }
  return stored;
}

// sqrt(3) integral(dep)  [m]
Lanes plastic_slip(const Problem& problem, const double* ep_old, const double* ep_new) {
  Lanes sum{};
  for (int i = 0; i < problem.grid.num_vertices(); ++i)
    add_change(sum, problem.grid.weight[static_cast<std::size_t>(i)], ep_old, ep_new, i);
  for (double& slip : sum) slip *= kSqrt3;
  return sum;
}

// The velocity through which a component of the interface's stress works, but for the host's own shear.
double working_velocity(const Problem& problem, double jump, double jump_new) {
  return problem.options.strategy == Strategy::kVelocityDriven ? jump : 0.5 * (jump + jump_new);
}

// The velocity of the host's own shear, along the stress (velocity-driven: with its sign).
double host_shear(const Problem& problem, const TileInputs& inputs, double stress, int lane) {
  const double h = problem.options.grid.thickness;
  if (problem.options.plastic_layer) return std::copysign(kSqrt3 * h * inputs.soft_plastic_strain_rate[lane], stress);
  const bool slips =
      problem.options.strategy == Strategy::kVelocityDriven && problem.options.drive == Drive::kInterfaceSlip;
  return slips ? h * inputs.soft_shear_rate[lane] : 0.0;
}

// Share of the plastic work that the scheme does not turn into heat.
double cold_share(const ModelOptions& options) {
  if (options.strategy == Strategy::kForceDriven) return 1.0;
  if (options.drive == Drive::kInterfaceSlip) return 1.0;  // the jump's work heats, the layer's own flow does not
  return 1.0 - options.taylor_quinney_factor.value_or(1.0);
}

}  // namespace

void record_energy(const Problem& problem, double dt, const TileInputs& inputs, const TileOutputs& outputs,
                   const double* committed, const double* trial, TileLedger& ledger) {
  const TileLayout& layout = problem.layout;
  const ModelOptions& options = problem.options;
  const double spring = options.strategy == Strategy::kVelocityDriven
                            ? 0.5 * options.grid.thickness / options.soft.shear_modulus
                            : 0.0;  // the force-driven balance (64) knows no elastic shear of the layer
  const Stored stored = stored_heat(problem, committed, trial, outputs.friction_heat);
  const Lanes plastic_slips =
      layout.plastic_strain == TileLayout::kAbsent
          ? Lanes{}
          : plastic_slip(problem, committed + layout.plastic_strain, trial + layout.plastic_strain);
  for (const int lane : lanes_of(inputs.active)) {
    const bool failed = (outputs.outcome[lane] & kFailed) != 0;  // nothing was done
    const double s_old = committed[layout.shear_stress + lane];
    const double s = trial[layout.shear_stress + lane];
    double size = s;  // of the stress, with its sign where there is one component
    double power = s * working_velocity(problem, inputs.velocity_jump[lane], outputs.velocity_jump_new[lane]);
    double elastic = spring * (s - s_old) * (s + s_old);
    if (options.tangential_components == 2) {
      const double t_old = committed[layout.second_stress + lane];
      const double t = trial[layout.second_stress + lane];
      size = std::hypot(s, t);
      power += t * working_velocity(problem, inputs.second_velocity_jump[lane], outputs.second_velocity_jump_new[lane]);
      elastic += spring * (t - t_old) * (t + t_old);
    }
    const double work = failed ? 0.0 : (power + size * host_shear(problem, inputs, size, lane)) * dt;
    const double plastic = std::abs(size) * plastic_slips[lane];
    const double heat = outputs.friction_heat[lane];

    // Between half-spaces each takes its share at once; where both are resolved, what they are found to hold.
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
