#include "hydro_stub/lagrange/geometry.hpp"

#include <array>
#include <cmath>
#include <cstddef>

#include "hydro_stub/lagrange/independent.hpp"

namespace shearbus::lagrange {
namespace {

using Corners = std::array<Vec2, 4>;

inline Corners corners_of(const RunNodes& at, int i) {
  return {at.corner(0, i), at.corner(1, i), at.corner(2, i), at.corner(3, i)};
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

inline double area_of(const Corners& x) {
  return 0.5 * cross(x[2] - x[0], x[3] - x[1]);
}

// Returns the volume of a zone whose shape functions have the integrals h.
inline double volume_about_axis(const Corners& x, const std::array<double, 4>& h) {
  return (x[0].x * h[0] + x[1].x * h[1]) + (x[2].x * h[2] + x[3].x * h[3]);
}

// The weights of a zone and where a run stores them.
struct ZoneWeights {
  std::array<Vec2, 4> b;
  std::array<double, 4> h;
  double area, volume;
};

inline ZoneWeights weights_in_plane(const Corners& x) {
  const double area = area_of(x);
  return {.b = {0.5 * right_of(x[1] - x[3]), 0.5 * right_of(x[2] - x[0]), 0.5 * right_of(x[3] - x[1]),
                0.5 * right_of(x[0] - x[2])},
          .h = {},
          .area = area,
          .volume = area};
}

// The radius is linear along an edge: edge k gives (2 r_k + r_{k+1}) n / 6 to corner k, with its normal n of its length.
inline ZoneWeights weights_about_axis(const Corners& x) {
  constexpr double kSixth = 1.0 / 6.0;
  const std::array<double, 4> h = shape_integrals(x);
  const Vec2 n0 = kSixth * right_of(x[1] - x[0]);
  const Vec2 n1 = kSixth * right_of(x[2] - x[1]);
  const Vec2 n2 = kSixth * right_of(x[3] - x[2]);
  const Vec2 n3 = kSixth * right_of(x[0] - x[3]);
  const auto radii = [](double nearer, double other) { return 2.0 * nearer + other; };
  const double r0 = x[0].x, r1 = x[1].x, r2 = x[2].x, r3 = x[3].x;
  return {.b = {Vec2{-h[0], 0.0} + radii(r0, r1) * n0 + radii(r0, r3) * n3,
                Vec2{-h[1], 0.0} + radii(r1, r0) * n0 + radii(r1, r2) * n1,
                Vec2{-h[2], 0.0} + radii(r2, r1) * n1 + radii(r2, r3) * n2,
                Vec2{-h[3], 0.0} + radii(r3, r2) * n2 + radii(r3, r0) * n3},
          .h = {h[0], h[1], h[2], h[3]},
          .area = area_of(x),
          .volume = volume_about_axis(x, h)};
}

template <bool kAboutAxis>
SHEARBUS_WIDE void measure_run(const Run& run, const RunNodes& at, Geometry& to) {
  double* __restrict area = to.area.data() + run.first;
  double* __restrict volume = to.volume.data() + run.first;
  double* __restrict b0x = to.weights.x[0] + run.first;
  double* __restrict b1x = to.weights.x[1] + run.first;
  double* __restrict b2x = to.weights.x[2] + run.first;
  double* __restrict b3x = to.weights.x[3] + run.first;
  double* __restrict b0y = to.weights.y[0] + run.first;
  double* __restrict b1y = to.weights.y[1] + run.first;
  double* __restrict b2y = to.weights.y[2] + run.first;
  double* __restrict b3y = to.weights.y[3] + run.first;
  double* __restrict h0 = to.hoop[0] + run.first;
  double* __restrict h1 = to.hoop[1] + run.first;
  double* __restrict h2 = to.hoop[2] + run.first;
  double* __restrict h3 = to.hoop[3] + run.first;
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < run.count; ++i) {
    const Corners x = corners_of(at, i);
    const ZoneWeights w = kAboutAxis ? weights_about_axis(x) : weights_in_plane(x);
    area[i] = w.area;
    volume[i] = w.volume;
    b0x[i] = w.b[0].x;
    b1x[i] = w.b[1].x;
    b2x[i] = w.b[2].x;
    b3x[i] = w.b[3].x;
    b0y[i] = w.b[0].y;
    b1y[i] = w.b[1].y;
    b2y[i] = w.b[2].y;
    b3y[i] = w.b[3].y;
    if (!kAboutAxis) continue;
    h0[i] = w.h[0];
    h1[i] = w.h[1];
    h2[i] = w.h[2];
    h3[i] = w.h[3];
  }
}

template <bool kAboutAxis>
SHEARBUS_WIDE void measure_volumes_of_run(const Run& run, const RunNodes& at, double* __restrict volume) {
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < run.count; ++i) {
    const Corners x = corners_of(at, i);
    volume[i] = kAboutAxis ? volume_about_axis(x, shape_integrals(x)) : area_of(x);
  }
}

SHEARBUS_WIDE void find_gradients_of_run(const Run& run, const Geometry& geometry, const RunNodes& at, Gradients& to) {
  const double* b_x[4];
  const double* b_y[4];
  const double* h[4];
  for (int k = 0; k < 4; ++k) {
    b_x[k] = geometry.weights.x[k] + run.first;
    b_y[k] = geometry.weights.y[k] + run.first;
    h[k] = geometry.hoop[k] + run.first;
  }
  const double* volume = geometry.volume.data() + run.first;
  double* __restrict xx = to.xx.data() + run.first;
  double* __restrict xy = to.xy.data() + run.first;
  double* __restrict yx = to.yx.data() + run.first;
  double* __restrict yy = to.yy.data() + run.first;
  double* __restrict tt = to.tt.data() + run.first;
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < run.count; ++i) {
    Gradient g{};
    for (int k = 0; k < 4; ++k) {
      const Vec2 v = at.corner(k, i);
      g.xx += v.x * b_x[k][i];
      g.xy += v.x * b_y[k][i];
      g.yx += v.y * b_x[k][i];
      g.yy += v.y * b_y[k][i];
      g.tt += v.x * h[k][i];
    }
    const double inverse = 1.0 / volume[i];
    xx[i] = g.xx * inverse;
    xy[i] = g.xy * inverse;
    yx[i] = g.yx * inverse;
    yy[i] = g.yy * inverse;
    tt[i] = g.tt * inverse;
  }
}

}  // namespace

void measure(Symmetry symmetry, const Run& run, const RunNodes& position, Geometry& geometry) {
  if (symmetry == Symmetry::kAxisymmetric) return measure_run<true>(run, position, geometry);
  measure_run<false>(run, position, geometry);
}

void measure_volumes(Symmetry symmetry, const Run& run, const RunNodes& position, std::vector<double>& volume) {
  double* to = volume.data() + run.first;
  if (symmetry == Symmetry::kAxisymmetric) return measure_volumes_of_run<true>(run, position, to);
  measure_volumes_of_run<false>(run, position, to);
}

void find_gradients(const Run& run, const Geometry& geometry, const RunNodes& velocity, Gradients& gradient) {
  find_gradients_of_run(run, geometry, velocity, gradient);
}

void measure(const Mesh& mesh, const std::vector<Vec2>& position, Geometry& geometry) {
  RunNodes at;
  for (const Run& run : mesh.runs()) {
    mesh.load(position, run, at);
    measure(mesh.symmetry(), run, at, geometry);
  }
}

void measure_volumes(const Mesh& mesh, const std::vector<Vec2>& position, std::vector<double>& volume) {
  RunNodes at;
  for (const Run& run : mesh.runs()) {
    mesh.load(position, run, at);
    measure_volumes(mesh.symmetry(), run, at, volume);
  }
}

void find_gradients(const Mesh& mesh, const Geometry& geometry, const std::vector<Vec2>& velocity,
                    Gradients& gradient) {
  RunNodes at;
  for (const Run& run : mesh.runs()) {
    mesh.load(velocity, run, at);
    find_gradients(run, geometry, at, gradient);
  }
}

std::vector<double> corner_volumes(const Mesh& mesh, const std::vector<Vec2>& position) {
  const bool axisymmetric = mesh.symmetry() == Symmetry::kAxisymmetric;
  // Abscissa +-1/sqrt(3) of the Gauss rule with two points in each direction, which integrates N_i r dA exactly.
  constexpr double kGauss = 0.57735026918962576;
  constexpr std::array<Vec2, 4> kReference = {Vec2{-1, -1}, Vec2{1, -1}, Vec2{1, 1}, Vec2{-1, 1}};
  std::vector<double> corner(4 * static_cast<std::size_t>(mesh.num_zones()), 0.0);
  for (int zone = 0; zone < mesh.num_zones(); ++zone) {
    const int* n = mesh.zone_nodes(zone);
    const Corners x = {position[n[0]], position[n[1]], position[n[2]], position[n[3]]};
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
