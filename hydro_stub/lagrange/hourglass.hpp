// Hourglass control (Flanagan & Belytschko, Int. J. Numer. Meth. Eng. 17 (1981) 679, viscous form). The mean velocity
// gradient of a zone does not contain the hourglass mode, in which the two diagonals move against each other. A force
// along this mode, orthogonal to every linear velocity field, damps the mode. The forces on a zone sum to zero, and
// their work heats the zone.
#pragma once

#include <vector>

#include "hydro_stub/lagrange/geometry.hpp"

namespace shearbus::lagrange {

// Adds the hourglass forces to the corner forces of the zones of a run. On square zones and at a Courant number of 1, a
// `coefficient` of 0.25 stops the mode within one step, and a larger coefficient lets the mode overshoot.
void add_hourglass(double coefficient, const Run& run, const RunNodes& position, const RunNodes& velocity,
                   const Geometry& geometry, const std::vector<double>& density, const std::vector<double>& sound_speed,
                   CornerVectors& force);

}  // namespace shearbus::lagrange
