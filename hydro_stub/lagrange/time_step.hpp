// The next time step.
#pragma once

#include <vector>

#include "hydro_stub/lagrange/geometry.hpp"

namespace shearbus::lagrange {

struct TimeStepOptions {
  double cfl = 0.7;
  double volume_change = 0.1;  // largest relative change of a zone's volume in a step, predicted from the step before
  double growth = 1.2;         // largest ratio of a step to the step before
  double first = 0.0;          // first step  [s]; 0: half of the Courant limit
};

// Returns the next step  [s]. Courant's limit of a wave equation with viscosity is (l/c) (sqrt(1 + (b/c)^2) - b/c),
// computed as l / (b + sqrt(b^2 + c^2)), where l = area / longest edge is the width of a zone, c the sound speed and b = l
// times the viscous rate. `old` is the step before, 0 at the start  [s].
double next_time_step(const Mesh& mesh, const TimeStepOptions& options, const Geometry& geometry,
                      const std::vector<Vec2>& position, const std::vector<double>& sound_speed,
                      const std::vector<double>& viscous_rate, const std::vector<double>& dilatation, double old);

}  // namespace shearbus::lagrange
