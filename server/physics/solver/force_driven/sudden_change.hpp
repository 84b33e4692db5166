// Steps in which stress or slip change so much that one step may be far from the answer of shorter steps (MODEL.md,
// "Force-driven step"): slip that starts near melting, and slip that turns. The outcome of such a step says kSudden.
#pragma once

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/solver/lane_step.hpp"

namespace shearbus::physics {

struct TrialSlip;

// Whether the jump after an undivided step may be off by more than this fraction of the larger of the jumps before the
// step and after a step without friction.
inline constexpr double kMostSudden = 0.1;

// Whether jump or stress differs by more than that from the state before the step. A step without this changes suddenly
// only if far stresses turn its slip.
bool moves_far(const TrialSlip& trial, const LaneStep& before, const LaneStep& step);

// `before`, `step`: the state before the step of a closed interface, and its answer.
bool changes_suddenly(const StressLimit& strength, const TrialSlip& trial, const FrictionHeating& heating,
                      const LaneStep& before, const LaneStep& step);

}  // namespace shearbus::physics
