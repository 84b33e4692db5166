#include "server/physics/solver/velocity_driven/inertia.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/step_operators.hpp"
#include "server/physics/solver/velocity_driven/waves.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

void gather(const double* rows, int count, double* values) {
  for (std::ptrdiff_t i = 0; i < count; ++i) values[i] = rows[i * kLanes];
}

void scatter(const double* values, int count, double* rows) {
  for (std::ptrdiff_t i = 0; i < count; ++i) rows[i * kLanes] = values[i];
}

// An open contact: the layer moves with the soft body without stress, until the contact closes.
void open_lane(const Problem& problem, const TileInputs& inputs, const double* committed, double* trial, int l,
               TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const double jump = inputs.velocity_jump[l];
  for (std::size_t i = 0; i < layout.num_stress_vertices; ++i) trial[layout.shear_stress + i * kLanes + l] = 0.0;
  for (std::size_t i = 0; i < layout.num_velocity_cells; ++i) trial[layout.layer_velocity + i * kLanes + l] = jump;
  for (std::size_t i = 0; i < layout.num_strain_vertices; ++i) {
    trial[layout.plastic_strain + i * kLanes + l] = committed[layout.plastic_strain + i * kLanes + l];
  }
  outputs.shear_stress[l] = 0.0;
  outputs.sliding_velocity[l] = jump;
  outputs.friction_heat[l] = 0.0;
  outputs.regime[l] = Regime::kOpen;
  outputs.outcome[l] = 0;
}

void closed_lane(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                 const double* committed, double* trial, int l, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const Grid& grid = problem.grid;
  const HeatOperator& heat = operators.heat();
  const int n = grid.num_cells();
  const double jump = inputs.velocity_jump[l];
  const Material soft = at_pressure(problem.options.soft, inputs.pressure[l]);
  const WaveStep step{.soft = &soft,
                      .grid = &grid,
                      .response = heat.layer_response(),
                      .dt = operators.dt(),
                      .pressure = inputs.pressure[l],
                      .jump = jump,
                      .heat_share = problem.heat_partition,
                      .coulomb = interface_strength(problem.interface, soft, inputs.pressure[l], nullptr)
                                     .friction(trial[layout.temperature + l])
                                     .stress};
  WaveFields fields;
  gather(trial + layout.temperature + l, n + 1, fields.T_ad);
  gather(committed + layout.plastic_strain + l, n + 1, fields.strain);
  gather(committed + layout.shear_stress + l, n + 1, fields.stress);
  gather(committed + layout.layer_velocity + l, n, fields.velocity);
  if (committed[layout.regime + l] == static_cast<double>(Regime::kOpen)) std::fill_n(fields.velocity, n, jump);

  const WaveAnswer answer = advance_waves(step, fields);
  if (inputs.effort != nullptr) {
    inputs.effort->newton_steps += answer.iterations;
    inputs.effort->guarded_steps += answer.guarded ? 1 : 0;
  }
  add_work(inputs, l, n * (1.0 + flow_work(soft.flow_law) * answer.iterations));
  if (!answer.found) return keep_lane(problem, inputs, committed, trial, l, outputs);

  double slip = answer.interface_slip;
  bool slips = slip != 0.0;
  for (int i = 0; i <= n; ++i) {
    // A vertex flows in the direction of its stress. A stress that has fallen to 0 keeps its sign as +0 or -0.
    slip += std::copysign(kSqrt3 * grid.weight[i] * fields.strain_growth[i] / step.dt, fields.stress[i]);
    slips = slips || fields.strain_growth[i] > 0.0;
    fields.strain[i] += fields.strain_growth[i];
  }
  scatter(fields.strain, n + 1, trial + layout.plastic_strain + l);
  scatter(fields.stress, n + 1, trial + layout.shear_stress + l);
  scatter(fields.velocity, n, trial + layout.layer_velocity + l);
  add_flux_lane(heat, problem.heat_grid.num_vertices(), l, answer.flux, trial + layout.first_temperature());

  gather(trial + layout.temperature + l, n + 1, fields.T_ad);
  const bool melts = *std::max_element(fields.T_ad, fields.T_ad + n + 1) >= kMeltingShare * soft.melting_temperature;
  outputs.shear_stress[l] = fields.stress[0];
  outputs.sliding_velocity[l] = slip;
  outputs.friction_heat[l] = answer.flux * step.dt;
  outputs.regime[l] = !slips                         ? Regime::kStick
                      : answer.interface_slip != 0.0 ? Regime::kCoulomb
                      : melts                        ? Regime::kMelting
                                                     : Regime::kTresca;
  outputs.outcome[l] = outside_domain(slip, jump);
}

}  // namespace

void advance_with_inertia(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                          const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  conduct(operators.heat(), problem.heat_grid.num_vertices(), committed + layout.first_temperature(),
          trial + layout.first_temperature());
  for (const int l : lanes_of(inputs.active)) {
    const bool open = inputs.pressure[l] <= 0.0;
    if (open) {
      open_lane(problem, inputs, committed, trial, l, outputs);
    } else {
      closed_lane(problem, operators, inputs, committed, trial, l, outputs);
    }
    outputs.interface_temperature[l] = trial[layout.temperature + l];
    outputs.velocity_jump_new[l] = inputs.velocity_jump[l];
    trial[layout.regime + l] = static_cast<double>(outputs.regime[l]);
  }
}

}  // namespace shearbus::physics
