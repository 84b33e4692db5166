// Artificial viscosity as a tensor in each zone, along its strongest compression only (the directional form of Kolev &
// Rieben, J. Comput. Phys. 228 (2009) 8336):
//
//     sigma_q = (1 - psi) phi mu lambda s s^T,    mu = rho l (c2 w |du| + sqrt((c2 w du)^2 + (c1 c)^2)),    du = l |lambda|
//
// Here mu is the viscosity and rho the density. lambda is the most negative eigenvalue of the strain rate in the plane
// (without a negative eigenvalue there is no viscosity), s the unit eigenvector of lambda, l the zone's length along s,
// du the velocity jump across the zone, c the sound speed, c1 = 0.2, c2 = 2, and w half the slope
// of the material's shock velocity over the velocity jump: with c1 = c2 = 1 and psi = 0 a jump du would get the
// shock pressure of the material's own Hugoniot. The limiter psi compares lambda with the rates in the zones on both
// sides, as is usual for second-order schemes (D. J. Benson, Comput. Methods Appl. Mech. Eng. 99 (1992) 235); psi is 1
// where the rate varies linearly through the neighbours. c1 sets the width of weak shocks, and c2 keeps strong ones from
// ringing: the smaller c1, the larger c2 has to be. Rigid rotation has no negative eigenvalue, and uniform compression
// has psi = 1, so neither has viscosity.
//
// The share phi keeps viscosity out of shear flow. lambda of a pure shear is negative, too, so that without phi viscosity
// would resist the flow of metal wherever its rate varies from zone to zone, as if the metal were stronger. With the
// dilatation d = div v, the volume's share of the compression is f = d / lambda between 0 and 1 (1 in any plane shock), and
//
//     phi = f + (1 - f) (1 - plastic rate / equivalent rate)
//
// with the equivalent strain rate and its plastic part, infinite in a fluid: shear has viscosity only as far as it is
// elastic. Elastic shear waves need it, since below unit Courant number nothing else damps the oscillations behind their
// fronts; metal that flows at constant volume has none.
//
// The stress acts through the same weights as all other stresses, so its forces on a zone
// cancel. Its work (1 - psi) phi mu lambda^2 is never negative: it only heats. Since the viscosity is directional, it does
// not shorten the time step of thin zones that are squeezed along their length.
#pragma once

#include <vector>

#include "hydro_stub/lagrange/geometry.hpp"

namespace shearbus::lagrange {

// What viscosity depends on, of all zones.
struct ViscousState {
  const Geometry& geometry;
  const Gradients& gradient;
  const std::vector<double>& density;
  const std::vector<double>& sound_speed;
  const std::vector<double>& plastic_rate;  // rate of the equivalent plastic strain, infinite in a fluid  [1/s]
};

// Sets the corner forces of the zones of a run to those of viscosity. Stores in `viscous_rate` the rate (1 - psi)
// phi mu / (rho l^2) at which viscosity evens out velocities  [1/s]; this rate limits the time step.
void set_viscosity(const Mesh& mesh, double half_shock_slope, const Run& run, const RunNodes& position,
                   const ViscousState& state, CornerVectors& force, std::vector<double>& viscous_rate);

}  // namespace shearbus::lagrange
