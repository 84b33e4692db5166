// Exact solutions of the verification problems.
#pragma once

#include <functional>

#include "hydro_stub/metal.hpp"

namespace shearbus::hydro {

// Returns the root of the increasing function f between `low` and `high`.
double root(double low, double high, const std::function<double(double)>& f);

// Returns the density of a metal at a pressure and zero specific internal energy.
double density_at(const lagrange::MieGrueneisen& metal, double pressure);

// The two waves in a hypo-elastic, perfectly plastic metal that is driven at a velocity: an elastic jump to the
// Hugoniot elastic limit, where the density is rho0 exp(Y/2G) (uniaxial strain Y/2G, deviator -2Y/3), and a plastic
// jump behind it.
struct TwoWaves {
  double elastic_stress, elastic_speed, elastic_velocity;
  double stress, plastic_speed, density;  // state behind both waves; plastic_speed in the laboratory frame
};
TwoWaves two_waves(const Metal& metal, double velocity);

// Velocity and stress of the face at which a flyer and its target touch after the impact, if both metals are beyond
// their elastic limits. At this velocity both metals have the same stress.
struct Impact {
  double velocity, stress;
};
Impact impact(const Metal& flyer, const Metal& target, double speed);

// Returns the initial speed u0 of the inner surface of an incompressible, perfectly plastic shell that comes to rest at
// the inner radius `stop`. The kinetic energy of the velocity field u = u0 (R0/r)^(d-1) in d dimensions equals the
// plastic work. Y is the flow stress, R0 and R1 are the initial inner and outer radius, and the metal that comes to
// rest at r started at r_start.
//   cylinder   rho u0^2 R0^2 ln(R1/R0)     = (4 Y / sqrt 3) integral of r ln(r_start/r) dr over the shell at rest
//   sphere     rho u0^2 R0^3 (1 - R0/R1)   = 4 Y integral of r^2 ln(r_start/r) dr over the shell at rest
double cylinder_speed(const Metal& metal, double inner, double outer, double stop);
double sphere_speed(const Metal& metal, double inner, double outer, double stop);

}  // namespace shearbus::hydro
