#include "hydro_stub/lagrange/time_step.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "hydro_stub/lagrange/independent.hpp"

namespace shearbus::lagrange {
namespace {

struct ZoneRates {
  const double* area;
  const double* sound_speed;
  const double* viscous_rate;
  const double* dilatation;
};

// Stores the limits of the zones of a run.
SHEARBUS_WIDE void limit_wide(const TimeStepOptions& options, const Run& run, const RunNodes& at,
                              const ZoneRates& zones, double* __restrict courant, double* __restrict volume) {
  const double cfl = options.cfl, volume_change = options.volume_change;
  const double* area = zones.area + run.first;
  const double* sound_speed = zones.sound_speed + run.first;
  const double* viscous_rate = zones.viscous_rate + run.first;
  const double* dilatation = zones.dilatation + run.first;
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < run.count; ++i) {
    const Vec2 x0 = at.corner(0, i), x1 = at.corner(1, i), x2 = at.corner(2, i), x3 = at.corner(3, i);
    const double a = dot(x1 - x0, x1 - x0), b = dot(x2 - x1, x2 - x1);
    const double c = dot(x3 - x2, x3 - x2), d = dot(x0 - x3, x0 - x3);
    const double ab = a < b ? b : a, cd = c < d ? d : c;
    const double longest = ab < cd ? cd : ab;
    const double width = area[i] / std::sqrt(longest);
    const double viscous = viscous_rate[i] * width;
    const double speed = viscous + std::sqrt(viscous * viscous + sound_speed[i] * sound_speed[i]);
    courant[i] = cfl * width / speed;
    volume[i] = volume_change / std::abs(dilatation[i]);
  }
}

}  // namespace

double next_time_step(const Mesh& mesh, const TimeStepOptions& options, const Geometry& geometry,
                      const std::vector<Vec2>& position, const std::vector<double>& sound_speed,
                      const std::vector<double>& viscous_rate, const std::vector<double>& dilatation, double old) {
  const ZoneRates rates = {geometry.area.data(), sound_speed.data(), viscous_rate.data(), dilatation.data()};
  const std::vector<Run>& runs = mesh.runs();
  double courant = std::numeric_limits<double>::infinity(), volume = courant;
#pragma omp parallel if (mesh.num_zones() >= kFewestForThreads) reduction(min : courant, volume)
  {
    RunNodes at;
    double of_courant[Run::kMostZones] = {}, of_volume[Run::kMostZones] = {};
#pragma omp for schedule(static) nowait
    for (std::size_t r = 0; r < runs.size(); ++r) {
      mesh.load(position, runs[r], at);
      limit_wide(options, runs[r], at, rates, of_courant, of_volume);
      for (int i = 0; i < runs[r].count; ++i) {
        if (of_courant[i] < courant) courant = of_courant[i];
        if (of_volume[i] < volume) volume = of_volume[i];
      }
    }
  }
  const double first = options.first > 0.0 ? options.first : 0.5 * courant;
  return std::min({courant, volume, old == 0.0 ? first : options.growth * old});
}

}  // namespace shearbus::lagrange
