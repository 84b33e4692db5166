#include "hydro_stub/lagrange/viscosity.hpp"

#include <cmath>

#include "hydro_stub/lagrange/independent.hpp"

namespace shearbus::lagrange {
namespace {

// Velocity differences below this share of the sound speed count as rounding, so that a body at rest or in rigid flight
// has no viscosity, and viscosity does not limit its time step.
constexpr double kRounding = 1e-10;

// Ratio of the rates of neighbouring zones up to which the limiter can be 1. In the foot of a shock rates grow by a factor
// of 2 to 3 a zone, and viscosity there would only widen it.
constexpr double kSteepest = 4.0;

struct Compression {
  double rate;     // lambda: the most negative eigenvalue of the strain rate  [1/s]
  Vec2 direction;  // unit eigenvector of `rate`
};

// The strain rate of a zone in the plane; `shear` is half the sum of the velocity gradient's components xy and yx.
struct StrainRate {
  double xx, yy, shear;
};

// The functions of a zone have no branches, so that loops over zones vectorise.
inline Compression strongest_compression(const StrainRate& d) {
  const double mean = 0.5 * (d.xx + d.yy);
  const double difference = 0.5 * (d.xx - d.yy);
  const double radius = std::sqrt(difference * difference + d.shear * d.shear);
  // Eigenvector of the strain rate for its lower eigenvalue, mean - radius, from the row of the matrix in which nothing
  // cancels.
  const bool first = difference > 0.0;
  const double ahead = radius + difference, back = radius - difference;
  const double along = first ? -d.shear : back, vy = first ? ahead : -d.shear;
  const double vx = radius > 0.0 ? along : 1.0;  // an isotropic rate has every direction
  const double inverse = 1.0 / std::sqrt(vx * vx + vy * vy);
  return {mean - radius, {inverse * vx, inverse * vy}};
}

inline double rate_along(const StrainRate& d, Vec2 s) {
  return s.x * s.x * d.xx + s.x * s.y * (2.0 * d.shear) + s.y * s.y * d.yy;
}

// Returns the length of a zone along the direction s, 1/|J^-1 s|; the columns of the matrix J are the zone's mean
// edges.
inline double length_along(const Vec2& across, const Vec2& up, Vec2 s) {
  const double inverse = 1.0 / cross(across, up);
  const Vec2 reference = {inverse * cross(s, up), inverse * cross(across, s)};
  return 1.0 / norm(reference);
}

inline double smaller(double a, double b) {
  return b < a ? b : a;
}

// Returns the share of the strongest compression that viscosity resists: the part of it that changes the volume, and of
// the rest, which is shear, the elastic part.
inline double resisted_share(const StrainRate& d, double tt, const Compression& c, double plastic_rate) {
  const double dilatation = d.xx + d.yy + tt;
  const double share = dilatation / c.rate;
  const double some = smaller(share, 1.0);
  const double volume = some < 0.0 ? 0.0 : some;
  const double mean = dilatation / 3.0;
  const double xx = d.xx - mean, yy = d.yy - mean, zz = tt - mean;
  const double equivalent_rate = std::sqrt(2.0 / 3.0 * (xx * xx + yy * yy + zz * zz + 2.0 * d.shear * d.shear));
  const double part = 1.0 - plastic_rate / equivalent_rate;
  const double elastic = part > 0.0 ? part : 0.0;
  return volume + (1.0 - volume) * elastic;
}

// Strain rates of zones in a row.
struct RateRow {
  double xx[Run::kMostZones + 2], yy[Run::kMostZones + 2], shear[Run::kMostZones + 2];
  StrainRate at(int i) const { return {xx[i], yy[i], shear[i]}; }
};

inline void fill(const Gradients& d, int first, int count, int to, RateRow& row) {
  const double* xx = d.xx.data() + first;
  const double* yy = d.yy.data() + first;
  const double* xy = d.xy.data() + first;
  const double* yx = d.yx.data() + first;
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < count; ++i) {
    row.xx[to + i] = xx[i];
    row.yy[to + i] = yy[i];
    row.shear[to + i] = 0.5 * (xy[i] + yx[i]);
  }
}

// A run and the zones around it: before the first one and behind the last one, below and above. At an edge of the block
// the zone on the other side stands for the one that is missing; a row or column of its own is its own neighbour.
struct Surroundings {
  RateRow own;  // zone i of the run at i + 1
  RateRow below, above;
};

inline int chosen(int wanted, int opposite, int own) {
  return wanted >= 0 ? wanted : opposite >= 0 ? opposite : own;
}

inline void find_surroundings(const Mesh& mesh, const Gradients& d, const Run& run, Surroundings& to) {
  const int first = run.first, last = run.first + run.count - 1;
  fill(d, first, run.count, 1, to.own);
  fill(d, chosen(mesh.neighbour(first, 3), mesh.neighbour(first, 1), first), 1, 0, to.own);
  fill(d, chosen(mesh.neighbour(last, 1), mesh.neighbour(last, 3), last), 1, run.count + 1, to.own);
  fill(d, chosen(mesh.neighbour(first, 0), mesh.neighbour(first, 2), first), run.count, 0, to.below);
  fill(d, chosen(mesh.neighbour(first, 2), mesh.neighbour(first, 0), first), run.count, 0, to.above);
}

SHEARBUS_WIDE void set_wide(const Mesh& mesh, double half_shock_slope, const Run& run, const RunNodes& position,
                            const ViscousState& state, CornerVectors& force, double* __restrict viscous_rate) {
  Surroundings around;
  find_surroundings(mesh, state.gradient, run, around);
  constexpr double linear = 0.2;                    // c1
  const double quadratic = 2.0 * half_shock_slope;  // c2 w
  const double* tt = state.gradient.tt.data() + run.first;
  const double* density = state.density.data() + run.first;
  const double* sound_speed = state.sound_speed.data() + run.first;
  const double* plastic_rate = state.plastic_rate.data() + run.first;
  double q_xx[Run::kMostZones], q_yy[Run::kMostZones], q_xy[Run::kMostZones];
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < run.count; ++i) {
    const StrainRate d = around.own.at(i + 1);
    const Compression most = strongest_compression(d);
    const Vec2 s = most.direction;
    const Vec2 across =
        0.5 * ((position.corner(1, i) - position.corner(0, i)) + (position.corner(2, i) - position.corner(3, i)));
    const Vec2 up =
        0.5 * ((position.corner(3, i) - position.corner(0, i)) + (position.corner(2, i) - position.corner(1, i)));
    const double length = length_along(across, up, s);
    const double closing = length * -most.rate;
    const double inverse = 1.0 / most.rate;
    const double left = rate_along(around.own.at(i), s) * inverse;
    const double right = rate_along(around.own.at(i + 2), s) * inverse;
    const double below = rate_along(around.below.at(i), s) * inverse;
    const double above = rate_along(around.above.at(i), s) * inverse;
    // The limiter psi of the viscosity: 1 in smooth flow, 0 at the edge of a shock; the smaller of the values for the
    // two directions of the mesh.
    double psi = smaller(smaller(1.0, 0.5 * (below + above)), smaller(kSteepest * below, kSteepest * above));
    psi = smaller(smaller(psi, 0.5 * (right + left)), smaller(kSteepest * right, kSteepest * left));
    psi = psi < 0.0 ? 0.0 : psi;
    const double limit = (1.0 - psi) * resisted_share(d, tt[i], most, plastic_rate[i]);
    const double shock = quadratic * length * -most.rate;
    const double sound = linear * sound_speed[i];
    const double speed = shock + std::sqrt(shock * shock + sound * sound);
    const double viscosity = limit * length * speed;
    const double diffusivity = closing > kRounding * sound_speed[i] ? viscosity : 0.0;  // never where rate >= 0
    const double stress = density[i] * diffusivity * most.rate;
    viscous_rate[i] = diffusivity / (length * length);
    q_xx[i] = stress * s.x * s.x;
    q_yy[i] = stress * s.y * s.y;
    q_xy[i] = stress * s.x * s.y;
  }
  for (int k = 0; k < 4; ++k) {
    const double* b_x = state.geometry.weights.x[k] + run.first;
    const double* b_y = state.geometry.weights.y[k] + run.first;
    double* __restrict f_x = force.x[k] + run.first;
    double* __restrict f_y = force.y[k] + run.first;
    SHEARBUS_INDEPENDENT
    for (int i = 0; i < run.count; ++i) {
      f_x[i] = -(q_xx[i] * b_x[i] + q_xy[i] * b_y[i]);
      f_y[i] = -(q_xy[i] * b_x[i] + q_yy[i] * b_y[i]);
    }
  }
}

}  // namespace

void set_viscosity(const Mesh& mesh, double half_shock_slope, const Run& run, const RunNodes& position,
                   const ViscousState& state, CornerVectors& force, std::vector<double>& viscous_rate) {
  set_wide(mesh, half_shock_slope, run, position, state, force, viscous_rate.data() + run.first);
}

}  // namespace shearbus::lagrange
