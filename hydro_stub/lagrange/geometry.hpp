// Volumes of zones and the weights that turn stresses into corner forces.
//
// A zone's volume is V = integral of r dA (r = 1 in plane symmetry), exact for the polygon. The derivative of V by the
// position of corner i is B_i = dV/dx_i = integral of r N_i n dl, and h_i = integral of N_i dA, with the bilinear shape
// functions N_i; in axisymmetry V = sum h_i r_i. With b_i = B_i - h_i e_r (in plane symmetry b_i = B_i) the means over
// a zone are
//
//     grad v = (1/V) sum v_i (x) b_i,     hoop rate D_tt = (1/V) sum u_i h_i,     dV/dt = sum v_i . B_i,
//
// and the forces that do the same work, sum F_i . v_i = -V (sigma : D), are F_i = -(sigma . b_i + sigma_tt h_i e_r).
// This is the true-volume (control-volume) form of compatible hydrodynamics (Caramana, Burton, Shashkov, Whalen, J.
// Comput. Phys. 146 (1998) 227). Energy closes to rounding in both symmetries. Since sum b_i = 0, momentum closes to
// rounding in the plane, and its axial component does in axisymmetry. With corner_volumes() as masses, plane waves
// along the axis stay plane and cylindrical waves stay cylindrical, to rounding, and uniform dilatation has no
// deviator; spherical symmetry is kept to second order only, as in every true-volume form.
#pragma once

#include <cstddef>
#include <vector>

#include "hydro_stub/lagrange/mesh.hpp"

namespace shearbus::lagrange {

struct Geometry {
  explicit Geometry(int num_zones) : Geometry(static_cast<std::size_t>(num_zones)) {}

  std::vector<Vec2> gradient_weight;  // b_i  [m in the plane, m2 per radian in axisymmetry: volume per length]
  std::vector<double> hoop_weight;    // h_i; 0 in plane symmetry
  std::vector<double> area;           // area of the zone in the plane  [m2]
  std::vector<double> volume;         // [m3 per metre of depth, or per radian]

 private:
  explicit Geometry(std::size_t zones)
      : gradient_weight(4 * zones), hoop_weight(4 * zones), area(zones), volume(zones) {}
};

// The velocity gradient of a zone in the plane, and the hoop rate D_tt.
struct Gradient {
  double xx, xy, yx, yy;  // xy: derivative of v_x by y  [1/s]
  double tt;
  double dilatation() const { return xx + yy + tt; }
};

void measure(const Mesh& mesh, const std::vector<Vec2>& position, Geometry& geometry);

// Computes only the volumes of the zones. If a step was too long, some volumes are not positive.
void measure_volumes(const Mesh& mesh, const std::vector<Vec2>& position, std::vector<double>& volume);

Gradient velocity_gradient(const Mesh& mesh, const Geometry& geometry, const std::vector<Vec2>& velocity, int zone);

// Integrals of N_i r dA: each corner's share of the volume of its zone. At uniform density they give the corner masses,
// which are fixed at the start.
std::vector<double> corner_volumes(const Mesh& mesh, const std::vector<Vec2>& position);

}  // namespace shearbus::lagrange
