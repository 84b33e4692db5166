// Steps in which stress or slip change so much that one step may be far from the answer of shorter steps (MODEL.md,
// "Force-driven step"): slip that starts near melting, and slip that turns. Such a step is divided.
#pragma once

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/solver/lane_step.hpp"

namespace shearbus::physics {

struct TrialSlip;

// An undivided step is kept if the jump after it is off by at most this fraction of the larger of the jumps before the
// step and after a step without friction, by the estimates of changes_suddenly().
inline constexpr double kSuddenChange = 0.1;
// A step that changes suddenly is divided into 2^kSuddenHalvings substeps, or more where those have no unique answer.
inline constexpr int kSuddenHalvings = 4;

// Whether the jump after the step may be off by more than kSuddenChange. `before`, `step`: the state before the closed
// step and its answer.
bool changes_suddenly(const StressLimit& strength, const TrialSlip& trial, const FrictionHeating& heating,
                      const LaneStep& before, const LaneStep& step);

}  // namespace shearbus::physics
