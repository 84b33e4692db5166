// Hourglass control (Flanagan & Belytschko, Int. J. Numer. Meth. Eng. 17 (1981) 679, viscous form): a zone's mean
// velocity gradient does not contain the mode in which its diagonals move against each other. A force along that mode,
// orthogonal to every linear velocity field, damps it; the force sums to zero and its work heats the zone.
#pragma once

#include <vector>

#include "hydro_stub/lagrange/geometry.hpp"

namespace shearbus::lagrange {

// Adds the hourglass forces to the corner forces of all zones. A `coefficient` of 0.25 damps a mode within about one
// step and is the stability limit at a Courant number of 1.
void add_hourglass(const Mesh& mesh, double coefficient, const Geometry& geometry, const std::vector<Vec2>& position,
                   const std::vector<Vec2>& velocity, const std::vector<double>& density,
                   const std::vector<double>& sound_speed, std::vector<Vec2>& corner_force);

}  // namespace shearbus::lagrange
