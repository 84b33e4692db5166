// The next time step and the condition that limits it.
#pragma once

#include <vector>

#include "hydro_stub/lagrange/geometry.hpp"

namespace shearbus::lagrange {

enum class StepLimit { kFirst, kCourant, kVolumeChange, kGrowth, kEnd, kRejected };
const char* name(StepLimit limit);

struct TimeStep {
  double dt = 0.0;  // [s]
  StepLimit limit = StepLimit::kFirst;
  int zone = -1;  // the limiting zone, if the Courant condition or the volume change limits the step
};

struct TimeStepOptions {
  double cfl = 0.7;
  double volume_change = 0.1;  // largest relative change of a zone's volume in a step, predicted from the step before
  double growth = 1.2;         // largest ratio of a step to the step before
  double first = 0.0;          // first step  [s]; 0: half of the Courant limit
};

// Returns the next step and the condition that limits it. Courant's limit of a wave equation with viscosity is (l/c)
// (sqrt(1 + (b/c)^2) - b/c), computed as l / (b + sqrt(b^2 + c^2)), where l = area / longest edge is the width of a
// zone, c the sound speed and b = l times the viscous rate. `old` is the step before; its dt is 0 at the start.
TimeStep next_time_step(const Mesh& mesh, const TimeStepOptions& options, const Geometry& geometry,
                        const std::vector<Vec2>& position, const std::vector<double>& sound_speed,
                        const std::vector<double>& viscous_rate, const std::vector<double>& dilatation,
                        const TimeStep& old);

}  // namespace shearbus::lagrange
