#include "server/physics/solver/force_driven/wide_slip.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <limits>
#include <variant>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/solver/sdirk2.hpp"

#define SHEARBUS_KERNELS "server/physics/solver/force_driven/wide_slip_kernel.hpp"
#include "server/physics/layer/each_register.hpp"

namespace shearbus::physics {

namespace {

bool has_wide_softening(FlowLaw flow_law) {
  return FlowLaws::with(flow_law, [](auto law) { return kHasWideSoftening<typename decltype(law)::type>; });
}

}  // namespace

WideInterface::WideInterface(const Problem& problem, const TileInputs& tile, const LaneMaterials& materials, double dt,
                             const double* committed)
    : inputs(tile),
      soft_at(materials),
      friction(form_of(problem.interface)),
      tresca(problem.interface.yield_strength / kSqrt3),
      yields_finitely(std::isfinite(tresca) && has_wide_softening(problem.options.soft.flow_law)),
      junctions(junctions_of(problem.options.junctions ? &*problem.options.junctions : nullptr, 0.0, dt)),
      junction_strain(problem.options.junctions ? committed + problem.layout.junction_strain : nullptr),
      stress_before(tile.stress_before ? tile.stress_before : committed + problem.layout.shear_stress) {}

std::uint32_t wide_slip(const WideStep& step, const WideStage& whole, WideAnswer& answer) {
  return SHEARBUS_CALL(slip_step, step, whole, answer);
}

StageLanes wide_first_stage(const WideStep& step, const WideStage& stage, StageAnswer& answer) {
  return SHEARBUS_CALL(first_stage, step, stage, answer);
}
StageLanes wide_second_stage(const WideStep& step, const WideStage& stage, const StageAnswer& early,
                             const StageLanes& before, WideAnswer& answer) {
  return SHEARBUS_CALL(second_stage, step, stage, early, before, answer);
}

void write_answer(const Problem& problem, const WideAnswer& answer, std::uint32_t found, double* trial,
                  TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  // Whole rows where all lanes are found: a row written value by value would stall the registers that read it next.
  const auto write = [&](const double* row, double* to) {
    if (found == kAllLanes) {
      std::copy_n(row, kLanes, to);
    } else {
      for (const int l : lanes_of(found)) to[l] = row[l];
    }
  };
  write(answer.stress, outputs.shear_stress);
  write(answer.stress, trial + layout.shear_stress);
  write(answer.slip, outputs.sliding_velocity);
  write(answer.jump_new, outputs.velocity_jump_new);
  write(answer.heat, outputs.friction_heat);
  write(answer.regime, trial + layout.regime);
  if (problem.options.junctions) write(answer.junction_strain, trial + layout.junction_strain);
  for (const int l : lanes_of(found)) {
    outputs.regime[l] = static_cast<Regime>(static_cast<int>(answer.regime[l]));
    outputs.outcome[l] = 0;
  }
}

}  // namespace shearbus::physics
