// Volumes of zones and the weights that turn stresses into corner forces.
//
// A zone's volume is V = integral of r dA, exact for the polygon; in plane symmetry the weight r is 1. N_i is the
// bilinear shape function of corner i, x_i = (r_i, z_i) its position and v_i, with radial component u_i, its velocity.
// Integrals over the zone and over its boundary (length dl, outward normal n) give the weights of corner i:
//
//     h_i = integral of N_i dA,     B_i = dV/dx_i = integral of r N_i n dl,     b_i = B_i - h_i e_r,
//
// with the radial unit vector e_r; in plane symmetry b_i = B_i, in axisymmetry V = sum h_i r_i. The means over a zone
// are
//
//     grad v = (1/V) sum v_i (x) b_i,     hoop rate D_tt = (1/V) sum u_i h_i,     dV/dt = sum v_i . B_i,
//
// and the forces F_i = -(sigma . b_i + sigma_tt h_i e_r) do the same work as the stress sigma with the strain rate D:
// sum F_i . v_i = -V (sigma : D). This is the true-volume (control-volume) form of compatible hydrodynamics (Caramana,
// Burton, Shashkov, Whalen, J. Comput. Phys. 146 (1998) 227). Energy closes to rounding in both symmetries. Since sum
// b_i = 0, momentum closes to rounding in the plane; in axisymmetry its axial component does. With corner_volumes() as
// masses, plane waves along the axis stay plane and cylindrical waves stay cylindrical, to rounding, and uniform
// dilatation has no deviator; spherical symmetry is kept to second order only, as in every true-volume form.
#pragma once

#include <cstddef>
#include <vector>

#include "hydro_stub/lagrange/mesh.hpp"

namespace shearbus::lagrange {

struct Geometry {
  explicit Geometry(int num_zones) : weights(num_zones), hoop(num_zones), area(num_zones), volume(num_zones) {}

  CornerVectors
      weights;         // weight b_i of each corner: volume per length  [m in the plane, m2 per radian in axisymmetry]
  CornerNumbers hoop;  // weight h_i of each corner; 0 in plane symmetry  [m2]
  std::vector<double> area;    // area of the zone in the plane  [m2]
  std::vector<double> volume;  // volume of the zone  [m3 per metre of depth, or per radian]
};

// The velocity gradient of a zone in the plane, and the hoop rate D_tt.
struct Gradient {
  double xx, xy, yx, yy;  // xy: derivative of v_x by y  [1/s]
  double tt;
  double dilatation() const { return xx + yy + tt; }
};

// The gradients of all zones.
struct Gradients {
  explicit Gradients(int num_zones) : xx(num_zones), xy(num_zones), yx(num_zones), yy(num_zones), tt(num_zones) {}
  Gradient operator[](int zone) const { return {xx[zone], xy[zone], yx[zone], yy[zone], tt[zone]}; }

  std::vector<double> xx, xy, yx, yy, tt;
};

// The functions of a run compute the values of its zones from values at their nodes.
void measure(Symmetry symmetry, const Run& run, const RunNodes& position, Geometry& geometry);
void find_gradients(const Run& run, const Geometry& geometry, const RunNodes& velocity, Gradients& gradient);
// Computes only the volumes of the zones. If a step was too long, some volumes are not positive.
void measure_volumes(Symmetry symmetry, const Run& run, const RunNodes& position, std::vector<double>& volume);

// The same for all zones, with one thread.
void measure(const Mesh& mesh, const std::vector<Vec2>& position, Geometry& geometry);
void find_gradients(const Mesh& mesh, const Geometry& geometry, const std::vector<Vec2>& velocity, Gradients& gradient);
void measure_volumes(const Mesh& mesh, const std::vector<Vec2>& position, std::vector<double>& volume);

// Returns the share of each corner in the volume of its zone, the integral of N_i r dA. Multiplied by the density of
// the zone at the start, the shares are the corner masses, which never change.
std::vector<double> corner_volumes(const Mesh& mesh, const std::vector<Vec2>& position);

}  // namespace shearbus::lagrange
