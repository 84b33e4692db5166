#include "hydro_stub/lagrange/geometry.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace shearbus::lagrange {
namespace {

using Corners = std::array<Vec2, 4>;

Corners corners_of(const Mesh& mesh, const std::vector<Vec2>& position, int zone) {
  const int* n = mesh.zone_nodes(zone);
  return {position[n[0]], position[n[1]], position[n[2]], position[n[3]]};
}

// Computes the integrals of the shape functions N_i over a zone exactly. The Jacobian is linear in the reference
// square, and its corner values are half the areas of the corner triangles. The array `j` holds twice these areas, and
// the mass matrix of the square is (4 2 1 2)/9; so the factor is 1/(4 * 9).
inline std::array<double, 4> shape_integrals(const Corners& x) {
  const std::array<double, 4> j = {cross(x[1] - x[0], x[3] - x[0]), cross(x[2] - x[1], x[0] - x[1]),
                                   cross(x[3] - x[2], x[1] - x[2]), cross(x[0] - x[3], x[2] - x[3])};
  const double even = 2.0 * (j[1] + j[3]);
  const double odd = 2.0 * (j[0] + j[2]);
  constexpr double kFactor = 1.0 / 36.0;
  return {kFactor * (4.0 * j[0] + even + j[2]), kFactor * (4.0 * j[1] + odd + j[3]),
          kFactor * (4.0 * j[2] + even + j[0]), kFactor * (4.0 * j[3] + odd + j[1])};
}

double area_of(const Corners& x) {
  return 0.5 * cross(x[2] - x[0], x[3] - x[1]);
}

// Returns the volume of a zone whose shape functions have the integrals h.
double volume_about_axis(const Corners& x, const std::array<double, 4>& h) {
  return (x[0].x * h[0] + x[1].x * h[1]) + (x[2].x * h[2] + x[3].x * h[3]);
}

}  // namespace

void measure(const Mesh& mesh, const std::vector<Vec2>& position, Geometry& geometry) {
  const int zones = mesh.num_zones();
  const bool axisymmetric = mesh.symmetry() == Symmetry::kAxisymmetric;
#pragma omp parallel for schedule(static) if (zones >= kFewestForThreads)
  for (int zone = 0; zone < zones; ++zone) {
    const Corners x = corners_of(mesh, position, zone);
    std::array<Vec2, 4> b;
    geometry.area[zone] = area_of(x);
    if (!axisymmetric) {
      for (int k = 0; k < 4; ++k) b[k] = 0.5 * right_of(x[(k + 1) % 4] - x[(k + 3) % 4]);
      std::ranges::copy(b, geometry.gradient_weight.begin() + std::ptrdiff_t{4} * zone);
      geometry.volume[zone] = geometry.area[zone];
      continue;
    }
    const std::array<double, 4> shape = shape_integrals(x);
    for (int k = 0; k < 4; ++k) b[k] = {-shape[k], 0.0};
    for (int k = 0; k < 4; ++k) {  // loop over the edges k; the radius is linear along an edge
      const int next = (k + 1) % 4;
      const Vec2 normal = (1.0 / 6.0) * right_of(x[next] - x[k]);
      b[k] += (2.0 * x[k].x + x[next].x) * normal;
      b[next] += (x[k].x + 2.0 * x[next].x) * normal;
    }
    std::ranges::copy(b, geometry.gradient_weight.begin() + std::ptrdiff_t{4} * zone);
    std::ranges::copy(shape, geometry.hoop_weight.begin() + std::ptrdiff_t{4} * zone);
    geometry.volume[zone] = volume_about_axis(x, shape);
  }
}

void measure_volumes(const Mesh& mesh, const std::vector<Vec2>& position, std::vector<double>& volume) {
  const int zones = mesh.num_zones();
  const bool axisymmetric = mesh.symmetry() == Symmetry::kAxisymmetric;
#pragma omp parallel for schedule(static) if (zones >= kFewestForThreads)
  for (int zone = 0; zone < zones; ++zone) {
    const Corners x = corners_of(mesh, position, zone);
    volume[zone] = axisymmetric ? volume_about_axis(x, shape_integrals(x)) : area_of(x);
  }
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
