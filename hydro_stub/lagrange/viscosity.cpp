#include "hydro_stub/lagrange/viscosity.hpp"

#include <algorithm>
#include <cmath>

namespace shearbus::lagrange {
namespace {

// Velocity differences below this share of the sound speed count as rounding, so that a body at rest or in rigid flight
// has no viscosity, and viscosity does not limit its time step.
constexpr double kRounding = 1e-10;

struct Compression {
  double rate;     // lambda: the most negative eigenvalue of the strain rate  [1/s]
  Vec2 direction;  // unit eigenvector of `rate`
};

Compression strongest_compression(const Gradient& d) {
  const double mean = 0.5 * (d.xx + d.yy);
  const double difference = 0.5 * (d.xx - d.yy);
  const double shear = 0.5 * (d.xy + d.yx);
  const double radius = std::sqrt(difference * difference + shear * shear);
  if (radius == 0.0) return {mean, {1.0, 0.0}};
  // Eigenvector of the strain rate for its lower eigenvalue, mean - radius, from the row of the matrix in which nothing
  // cancels.
  const Vec2 v = difference > 0.0 ? Vec2{-shear, difference + radius} : Vec2{radius - difference, -shear};
  return {mean - radius, (1.0 / norm(v)) * v};
}

double rate_along(const Gradient& d, Vec2 s) {
  return s.x * s.x * d.xx + s.x * s.y * (d.xy + d.yx) + s.y * s.y * d.yy;
}

// Returns the length of a zone along the direction s, 1/|J^-1 s|; the columns of the matrix J are the zone's mean
// edges.
double length_along(const Vec2& across, const Vec2& up, Vec2 s) {
  const double inverse = 1.0 / cross(across, up);
  const Vec2 reference = {inverse * cross(s, up), inverse * cross(across, s)};
  return 1.0 / norm(reference);
}

// Returns the limiter psi of the viscosity: 1 in smooth flow, 0 at the edge of a shock. psi is the smaller of the
// values for the two directions of the mesh.
double smoothness(const Mesh& mesh, const std::vector<Gradient>& gradient, int zone, const Compression& c) {
  double psi = 1.0;
  for (const int k : {0, 1}) {
    const int back = mesh.neighbour(zone, k);
    const int ahead = mesh.neighbour(zone, k + 2);
    if (back < 0 && ahead < 0) continue;
    const double inverse = 1.0 / c.rate;
    const double behind = rate_along(gradient[back < 0 ? ahead : back], c.direction) * inverse;
    const double before = rate_along(gradient[ahead < 0 ? back : ahead], c.direction) * inverse;
    psi = std::min({psi, 0.5 * (behind + before), 2.0 * behind, 2.0 * before});
  }
  return std::max(0.0, psi);
}

// Returns the share of the strongest compression that viscosity resists: the part of it that changes the volume, and of
// the rest, which is shear, the elastic part.
double resisted_share(const Gradient& d, const Compression& c, double plastic_rate) {
  const double volume = std::clamp(d.dilatation() / c.rate, 0.0, 1.0);
  const double mean = d.dilatation() / 3.0;
  const double xx = d.xx - mean, yy = d.yy - mean, tt = d.tt - mean, xy = 0.5 * (d.xy + d.yx);
  const double equivalent_rate = std::sqrt(2.0 / 3.0 * (xx * xx + yy * yy + tt * tt + 2.0 * xy * xy));
  const double elastic = plastic_rate < equivalent_rate ? 1.0 - plastic_rate / equivalent_rate : 0.0;
  return volume + (1.0 - volume) * elastic;
}

}  // namespace

void add_viscosity(const Mesh& mesh, const ViscosityOptions& options, double half_shock_slope, const Geometry& geometry,
                   const std::vector<Vec2>& position, const std::vector<Gradient>& gradient,
                   const std::vector<double>& density, const std::vector<double>& sound_speed,
                   const std::vector<double>& plastic_rate, int first, int last, std::vector<Vec2>& corner_force,
                   std::vector<double>& viscous_rate) {
#pragma omp parallel for schedule(static) if (last - first >= kFewestForThreads)
  for (int zone = first; zone < last; ++zone) {
    viscous_rate[zone] = 0.0;
    const Gradient& d = gradient[zone];
    const Compression c = strongest_compression(d);
    if (!(c.rate < 0.0)) continue;
    const int* n = mesh.zone_nodes(zone);
    const Vec2 across = 0.5 * ((position[n[1]] - position[n[0]]) + (position[n[2]] - position[n[3]]));
    const Vec2 up = 0.5 * ((position[n[3]] - position[n[0]]) + (position[n[2]] - position[n[1]]));
    const double length = length_along(across, up, c.direction);
    if (length * -c.rate <= kRounding * sound_speed[zone]) continue;
    const double limit = (1.0 - smoothness(mesh, gradient, zone, c)) * resisted_share(d, c, plastic_rate[zone]);
    const double shock = options.quadratic * half_shock_slope * length * -c.rate;
    const double sound = options.linear * sound_speed[zone];
    const double diffusivity = limit * length * (shock + std::sqrt(shock * shock + sound * sound));
    viscous_rate[zone] = diffusivity / (length * length);
    const double stress = density[zone] * diffusivity * c.rate;
    const double xx = stress * c.direction.x * c.direction.x;
    const double yy = stress * c.direction.y * c.direction.y;
    const double xy = stress * c.direction.x * c.direction.y;
    for (int k = 0; k < 4; ++k) {
      const Vec2 b = geometry.gradient_weight[4 * zone + k];
      corner_force[4 * zone + k] -= Vec2{xx * b.x + xy * b.y, xy * b.x + yy * b.y};
    }
  }
}

}  // namespace shearbus::lagrange
