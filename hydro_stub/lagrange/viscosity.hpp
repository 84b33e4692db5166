// Artificial viscosity on the edges of zones (Caramana, Shashkov, Whalen, J. Comput. Phys. 144 (1998) 70).
//
// Across an edge with velocity difference dv the shock viscosity is that of the material's own Hugoniot,
//     q = rho |dv| (1 - psi) (c2 w |dv| + sqrt((c2 w dv)^2 + (c1 c)^2)),     w half the slope of Us(up),
// and pulls the edge's nodes toward each other's velocity over the area S between edge and zone centre, where the edge
// is being shortened (dv . S < 0). psi = 1 where dv varies linearly along the mesh line: uniform compression and rigid
// rotation cost nothing. Forces of an edge are equal and opposite and can only heat.
#pragma once

#include <vector>

#include "hydro_stub/lagrange/geometry.hpp"

namespace shearbus::lagrange {

struct ViscosityOptions {
  double linear = 1.0;     // c1
  double quadratic = 1.0;  // c2
};

// Adds to the corner forces of the zones [first, last), and puts there the largest viscous speed of each zone, q/(rho
// |dv|), which limits the time step  [m/s].
void add_viscosity(const Mesh& mesh, const ViscosityOptions& options, double half_shock_slope,
                   const std::vector<Vec2>& position, const std::vector<Vec2>& velocity,
                   const std::vector<double>& density, const std::vector<double>& sound_speed, int first, int last,
                   std::vector<Vec2>& corner_force, std::vector<double>& viscous_speed);

}  // namespace shearbus::lagrange
