// Checks that one step satisfies the invariants of server/physics/MODEL.md, "What always holds"; a check that fails
// throws Broken. The property tests and the stability campaign use the same checks. The campaign also applies them to
// deliberately wrong solvers, which must fail. The folder tests/support/invariants has one file for each check.
#pragma once

#include <cstddef>

#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/broken.hpp"
#include "tests/support/invariants/dissipation.hpp"
#include "tests/support/invariants/figures.hpp"
#include "tests/support/invariants/finite.hpp"
#include "tests/support/invariants/flow_stress.hpp"
#include "tests/support/invariants/flowing_slip.hpp"
#include "tests/support/invariants/heat_balance.hpp"
#include "tests/support/invariants/heat_in_place.hpp"
#include "tests/support/invariants/heat_of_work.hpp"
#include "tests/support/invariants/interface_law.hpp"
#include "tests/support/invariants/layer_slip.hpp"
#include "tests/support/invariants/melt_film.hpp"
#include "tests/support/invariants/temperatures.hpp"

namespace shearbus::testing {

// Checks the invariants that do not depend on the strategy (MODEL.md, "What always holds"): the answer is finite,
// temperatures are in their range, friction dissipates, heat and work balance.
inline void require_sound(const Rig& rig, const Answered& a, int lane, Figures& figures) {
  const ModelOptions& options = rig.model.options();
  const bool has_profile = rig.model.layout().heat_modes == TileLayout::kAbsent;
  require_numbers(a);
  require_temperatures(rig, a, lane, figures);
  require_dissipation(a);
  // Without a temperature profile the heat is kept in modes. The modes give the stored heat only for an insulated slab,
  // whose mode with decay rate 0 contains all heat.
  if (has_profile || !HeatKernel(options.soft, options.grid).far_face_unfelt(options.modes->longest_time)) {
    const double left = heat_left_through_held_faces(rig, lane, a.dt);
    const double before = rig.stored_heat_of(rig.trial, 0.0, lane), after = rig.stored_heat(0.0, lane);
    if (std::isfinite(left))
      require_heat_balance(before, after, a.heat - left, figures, conducts_by_temperature(options) ? 1e-4 : 0.0);
  }
  if (options.inertia && options.taylor_quinney_factor)
    require_heat_in_place(rig, a, lane);
  else
    require_heat_of_work(options, rig.conducted_share(), a);
}

// Checks all invariants for one lane of the rig's last step.
inline void require_invariants(const Rig& rig, int lane, double dt, Figures& figures) {
  const ModelOptions& options = rig.model.options();
  const Answered a = answered(rig, lane, dt);
  if ((a.outcome & kFailed) != 0 && may_lack_an_answer(rig, a, lane)) return require_kept(rig, lane);
  require_sound(rig, a, lane, figures);
  if (options.strategy == Strategy::kVelocityDriven) {
    require_complementary_flow(rig, a, lane, rig.slept(lane) ? kSleeperGrain : 0.0, figures);
    if (!options.inertia) require_slip_balance(rig, a, lane);
  } else {
    require_interface_law(options, a, figures);
    if (options.inertia)
      require_complementary_flow(rig, a, lane, 0.0, figures);
    else if (options.plastic_layer)
      require_flowing_slip(rig, a, lane, figures);
    if (options.melt_film) require_film(rig, a, lane, interface_limits(options, a, a.size()).lower, figures);
  }
  ++figures.node_steps;
  ++figures.in_regime[static_cast<std::size_t>(a.regime)];
  figures.divided += a.divided();
  figures.several += (a.outcome & kMultipleRoots) != 0;
}

}  // namespace shearbus::testing
