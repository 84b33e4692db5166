// Slip balance, DLP (64), of a force-driven step with a flowing layer.
#pragma once

#include <algorithm>
#include <cmath>

#include "tests/support/invariants/flow_stress.hpp"
#include "tests/support/invariants/interface_limits.hpp"

namespace shearbus::testing {

// Requires the slip balance DLP (64) of a flowing layer: at the middle of the step if the interface slips, at the end
// of the step if the interface sticks.
inline void require_flowing_slip(const Rig& rig, const Answered& a, int lane, Figures& figures) {
  // Signs are relative to the stress, so a step without stress is not checked.
  if (a.pressure <= 0.0 || a.in_parts() || a.stress == 0.0) return;
  const double d = std::copysign(1.0, a.stress);
  const double jump_old = d * a.jump_old, jump_new = d * a.jump_new;
  const double drive = d * a.plastic_drive;
  const double flow = (rig.plastic_slip(lane) - rig.plastic_slip_of(rig.trial, lane)) / a.dt;
  const double size = std::abs(jump_old) + std::abs(jump_new) + a.plastic_drive_size + flow + a.driven_size;
  const ModelOptions& options = rig.model.options();
  ++figures.flowing;
  if (!is_resolved(options, a, size)) return;
  ++figures.flowing_resolved;
  const double grain = heat_grain(options, a, size) + (rig.slept(lane) ? kSleeperGrain : 0.0);
  require_complementary_flow(rig, a, lane, grain, figures);
  // Twice the change of the flow by the last digits: those of the stress, and those of the heat that goes with it.
  double tolerance = 1e-9 * size + 1e-14 * rig.plastic_slip(lane) / a.dt +
                     2.0 * kSqrt3 * flow_grain(rig, strain_before(rig, lane), a.stress, lane, a.dt, grain) / a.dt;
  if (a.sticks) {
    require_near(jump_new + drive, flow, tolerance, "(64) of an interface that sticks");
    require_near(d * a.slip, std::max(0.0, 0.5 * (jump_old - jump_new)), 1e-9 * size, "[v] of an interface that stops");
  } else {
    // An error of the stress limit makes an error of the slip, for two reasons: the stress changes the velocity jump,
    // DLP (61), and stress times slip is the heat on which the limit depends.
    const Limits limit = interface_limits(options, a, size);
    tolerance += (limit.upper - limit.lower) * (a.per_stress + std::abs(a.slip / a.stress));
    require_near(d * a.slip, std::max(0.0, 0.5 * (jump_old + jump_new) + drive - flow), tolerance, "(64)");
    require(jump_new + drive - flow >= -tolerance, "friction pulls past rest: {} m/s", jump_new + drive - flow);
  }
}

}  // namespace shearbus::testing
