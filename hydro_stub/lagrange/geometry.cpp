#include "hydro_stub/lagrange/geometry.hpp"

#include <array>
#include <cmath>

namespace shearbus::lagrange {
namespace {

using Corners = std::array<Vec2, 4>;

Corners corners_of(const Mesh& mesh, const std::vector<Vec2>& position, int zone) {
  const int* n = mesh.zone_nodes(zone);
  return {position[n[0]], position[n[1]], position[n[2]], position[n[3]]};
}

// Computes the integrals of the shape functions N_i over a zone exactly. The Jacobian is linear in the reference
// square, and its corner values are half the areas of the corner triangles. The array `jacobian` holds twice these
// areas, and the mass matrix of the square is (4 2 1 2)/9; so the divisor is 4 * 9 = 36.
std::array<double, 4> shape_integrals(const Corners& x) {
  std::array<double, 4> jacobian;
  for (int k = 0; k < 4; ++k) jacobian[k] = cross(x[(k + 1) % 4] - x[k], x[(k + 3) % 4] - x[k]);
  std::array<double, 4> integral;
  for (int k = 0; k < 4; ++k) {
    integral[k] =
        (4.0 * jacobian[k] + 2.0 * (jacobian[(k + 1) % 4] + jacobian[(k + 3) % 4]) + jacobian[(k + 2) % 4]) / 36.0;
  }
  return integral;
}

double area_of(const Corners& x) {
  return 0.5 * cross(x[2] - x[0], x[3] - x[1]);
}

double volume_about_axis(const Corners& x) {
  const std::array<double, 4> h = shape_integrals(x);
  return (x[0].x * h[0] + x[1].x * h[1]) + (x[2].x * h[2] + x[3].x * h[3]);
}

}  // namespace

void measure(const Mesh& mesh, const std::vector<Vec2>& position, Geometry& geometry) {
  const int zones = mesh.num_zones();
  const bool axisymmetric = mesh.symmetry() == Symmetry::kAxisymmetric;
#pragma omp parallel for schedule(static) if (zones >= kFewestForThreads)
  for (int zone = 0; zone < zones; ++zone) {
    const Corners x = corners_of(mesh, position, zone);
    Vec2* b = geometry.gradient_weight.data() + 4 * zone;
    double* h = geometry.hoop_weight.data() + 4 * zone;
    geometry.area[zone] = area_of(x);
    if (!axisymmetric) {
      for (int k = 0; k < 4; ++k) b[k] = 0.5 * right_of(x[(k + 1) % 4] - x[(k + 3) % 4]);
      geometry.volume[zone] = geometry.area[zone];
      continue;
    }
    const std::array<double, 4> shape = shape_integrals(x);
    for (int k = 0; k < 4; ++k) {
      h[k] = shape[k];
      b[k] = {-shape[k], 0.0};
    }
    for (int k = 0; k < 4; ++k) {  // loop over the edges k; the radius is linear along an edge
      const int next = (k + 1) % 4;
      const Vec2 normal = right_of(x[next] - x[k]);
      b[k] += ((2.0 * x[k].x + x[next].x) / 6.0) * normal;
      b[next] += ((x[k].x + 2.0 * x[next].x) / 6.0) * normal;
    }
    geometry.volume[zone] = volume_about_axis(x);
  }
}

void measure_volumes(const Mesh& mesh, const std::vector<Vec2>& position, std::vector<double>& volume) {
  const int zones = mesh.num_zones();
  const bool axisymmetric = mesh.symmetry() == Symmetry::kAxisymmetric;
#pragma omp parallel for schedule(static) if (zones >= kFewestForThreads)
  for (int zone = 0; zone < zones; ++zone) {
    const Corners x = corners_of(mesh, position, zone);
    volume[zone] = axisymmetric ? volume_about_axis(x) : area_of(x);
  }
}

Gradient velocity_gradient(const Mesh& mesh, const Geometry& geometry, const std::vector<Vec2>& velocity, int zone) {
  const int* n = mesh.zone_nodes(zone);
  const Vec2* b = geometry.gradient_weight.data() + 4 * zone;
  const double* h = geometry.hoop_weight.data() + 4 * zone;
  Gradient g{};
  for (int k = 0; k < 4; ++k) {
    const Vec2 v = velocity[n[k]];
    g.xx += v.x * b[k].x;
    g.xy += v.x * b[k].y;
    g.yx += v.y * b[k].x;
    g.yy += v.y * b[k].y;
    g.tt += v.x * h[k];
  }
  const double inverse = 1.0 / geometry.volume[zone];
  return {g.xx * inverse, g.xy * inverse, g.yx * inverse, g.yy * inverse, g.tt * inverse};
}

std::vector<double> corner_volumes(const Mesh& mesh, const std::vector<Vec2>& position) {
  const bool axisymmetric = mesh.symmetry() == Symmetry::kAxisymmetric;
  // Abscissa +-1/sqrt(3) of the Gauss rule with two points in each direction, which integrates N_i r dA exactly.
  constexpr double kGauss = 0.57735026918962576;
  constexpr std::array<Vec2, 4> kReference = {Vec2{-1, -1}, Vec2{1, -1}, Vec2{1, 1}, Vec2{-1, 1}};
  std::vector<double> corner(4 * static_cast<std::size_t>(mesh.num_zones()), 0.0);
  for (int zone = 0; zone < mesh.num_zones(); ++zone) {
    const Corners x = corners_of(mesh, position, zone);
    for (const Vec2 point : kReference) {
      std::array<double, 4> shape;
      Vec2 along_xi, along_eta;
      double radius = 0.0;
      for (int k = 0; k < 4; ++k) {
        const double xi = 1.0 + kGauss * point.x * kReference[k].x;
        const double eta = 1.0 + kGauss * point.y * kReference[k].y;
        shape[k] = 0.25 * xi * eta;
        along_xi += (0.25 * kReference[k].x * eta) * x[k];
        along_eta += (0.25 * kReference[k].y * xi) * x[k];
        radius += shape[k] * x[k].x;
      }
      const double weight = cross(along_xi, along_eta) * (axisymmetric ? radius : 1.0);
      for (int k = 0; k < 4; ++k) corner[4 * zone + k] += shape[k] * weight;
    }
  }
  return corner;
}

}  // namespace shearbus::lagrange
