#include "hydro_stub/lagrange/hourglass.hpp"

#include <cmath>

#include "hydro_stub/lagrange/independent.hpp"

namespace shearbus::lagrange {
namespace {

SHEARBUS_WIDE void add_wide(double coefficient, const Run& run, const RunNodes& position, const RunNodes& velocity,
                            const double* area, const double* volume, const double* density, const double* sound_speed,
                            CornerVectors& force) {
  double mode[4][Run::kMostZones], pull_x[Run::kMostZones], pull_y[Run::kMostZones];
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < run.count; ++i) {
    const Vec2 x0 = position.corner(0, i), x1 = position.corner(1, i);
    const Vec2 x2 = position.corner(2, i), x3 = position.corner(3, i);
    const Vec2 skew = (x0 - x1) + (x2 - x3);
    const double inverse_area = 1.0 / area[i];
    // The hourglass mode (+1, -1, +1, -1 on the corners) less the part that linear velocity fields contain; the slopes
    // of the corners 2 and 3 are those of 0 and 1, negative.
    const double along = inverse_area * dot(0.5 * right_of(x1 - x3), skew);
    const double across = inverse_area * dot(0.5 * right_of(x2 - x0), skew);
    const double mode0 = 1.0 - along, mode1 = -1.0 - across, mode2 = 1.0 + along, mode3 = -1.0 + across;
    const Vec2 rate =
        ((mode0 * velocity.corner(0, i) + mode1 * velocity.corner(1, i)) + mode2 * velocity.corner(2, i)) +
        mode3 * velocity.corner(3, i);
    const double mean_radius = volume[i] * inverse_area;  // mean radius of the zone; 1 in plane symmetry
    const double damping = 0.25 * coefficient * density[i] * sound_speed[i] * std::sqrt(area[i]) * mean_radius;
    mode[0][i] = damping * mode0;
    mode[1][i] = damping * mode1;
    mode[2][i] = damping * mode2;
    mode[3][i] = damping * mode3;
    pull_x[i] = rate.x;
    pull_y[i] = rate.y;
  }
  for (int k = 0; k < 4; ++k) {
    double* __restrict f_x = force.x[k] + run.first;
    double* __restrict f_y = force.y[k] + run.first;
    SHEARBUS_INDEPENDENT
    for (int i = 0; i < run.count; ++i) {
      f_x[i] -= mode[k][i] * pull_x[i];
      f_y[i] -= mode[k][i] * pull_y[i];
    }
  }
}

}  // namespace

void add_hourglass(double coefficient, const Run& run, const RunNodes& position, const RunNodes& velocity,
                   const Geometry& geometry, const std::vector<double>& density, const std::vector<double>& sound_speed,
                   CornerVectors& force) {
  if (coefficient == 0.0) return;
  add_wide(coefficient, run, position, velocity, geometry.area.data() + run.first, geometry.volume.data() + run.first,
           density.data() + run.first, sound_speed.data() + run.first, force);
}

}  // namespace shearbus::lagrange
