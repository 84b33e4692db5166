// Artificial viscosity as a tensor in each zone, along its strongest compression only (the directional form of Kolev &
// Rieben, J. Comput. Phys. 228 (2009) 8336):
//
//     sigma_q = (1 - psi) mu lambda s s^T,    mu = rho l (c2 w |du| + sqrt((c2 w du)^2 + (c1 c)^2)),    du = l |lambda|
//
// lambda is the most negative eigenvalue of the strain rate in the plane (without one there is no viscosity), s its
// direction, l the zone's length along it, and w half the slope of the material's Us(up): a jump du then feels the
// shock pressure of its own Hugoniot. psi limits by the zones on both sides, as is usual for second-order schemes (D.
// J. Benson, Comput. Methods Appl. Mech. Eng. 99 (1992) 235): 1 where the rate varies linearly through the neighbours.
// Rigid rotation has no lambda and uniform compression psi = 1: neither costs anything. The stress acts through the
// same weights as all others, so its forces cancel in a zone, and its work mu lambda^2 only heats. Being directional it
// leaves thin zones that are squeezed along their length their time step.
#pragma once

#include <vector>

#include "hydro_stub/lagrange/geometry.hpp"

namespace shearbus::lagrange {

struct ViscosityOptions {
  double linear = 1.0;     // c1
  double quadratic = 1.0;  // c2
};

// Adds to the corner forces of the zones [first, last), and puts there the rate (1 - psi) mu / (rho l^2) at which
// viscosity evens out velocities, which limits the time step  [1/s].
void add_viscosity(const Mesh& mesh, const ViscosityOptions& options, double half_shock_slope, const Geometry& geometry,
                   const std::vector<Vec2>& position, const std::vector<Gradient>& gradient,
                   const std::vector<double>& density, const std::vector<double>& sound_speed, int first, int last,
                   std::vector<Vec2>& corner_force, std::vector<double>& viscous_rate);

}  // namespace shearbus::lagrange
