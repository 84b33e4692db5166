#include "hydro_stub/lagrange/time_step.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "hydro_stub/lagrange/independent.hpp"

namespace shearbus::lagrange {

const char* name(StepLimit limit) {
  switch (limit) {
    case StepLimit::kFirst:
      return "first step";
    case StepLimit::kCourant:
      return "Courant";
    case StepLimit::kVolumeChange:
      return "volume change";
    case StepLimit::kGrowth:
      return "growth";
    case StepLimit::kEnd:
      return "end time";
    case StepLimit::kRejected:
      return "rejected step";
  }
  return "?";
}

namespace {

// A limit of the step and the first zone that sets it.
struct Limit {
  double dt = std::numeric_limits<double>::infinity();
  int zone = -1;
  void take(const Limit& other) {
    if (other.dt < dt || (other.dt == dt && other.zone < zone)) *this = other;
  }
  void take(const Run& run, const double* all) {
    for (int i = 0; i < run.count; ++i) {
      if (all[i] < dt) *this = {.dt = all[i], .zone = run.first + i};
    }
  }
};
struct Limits {
  Limit courant, volume;
};

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

TimeStep next_time_step(const Mesh& mesh, const TimeStepOptions& options, const Geometry& geometry,
                        const std::vector<Vec2>& position, const std::vector<double>& sound_speed,
                        const std::vector<double>& viscous_rate, const std::vector<double>& dilatation,
                        const TimeStep& old) {
  const ZoneRates rates = {geometry.area.data(), sound_speed.data(), viscous_rate.data(), dilatation.data()};
  const std::vector<Run>& runs = mesh.runs();
  Limits all;
#pragma omp parallel if (mesh.num_zones() >= kFewestForThreads)
  {
    Limits some;
    RunNodes at;
    double of_courant[Run::kMostZones] = {}, of_volume[Run::kMostZones] = {};
#pragma omp for schedule(static) nowait
    for (std::size_t r = 0; r < runs.size(); ++r) {
      mesh.load(position, runs[r], at);
      limit_wide(options, runs[r], at, rates, of_courant, of_volume);
      some.courant.take(runs[r], of_courant);
      some.volume.take(runs[r], of_volume);
    }
#pragma omp critical(shearbus_time_step)
    {
      all.courant.take(some.courant);
      all.volume.take(some.volume);
    }
  }
  const TimeStep courant{all.courant.dt, StepLimit::kCourant, all.courant.zone};
  const TimeStep volume{all.volume.dt, StepLimit::kVolumeChange, all.volume.zone};
  TimeStep step = volume.dt < courant.dt ? volume : courant;
  if (old.dt == 0.0) {
    const double first = options.first > 0.0 ? options.first : 0.5 * courant.dt;
    if (first < step.dt) step = {first, StepLimit::kFirst, -1};
  } else if (options.growth * old.dt < step.dt) {
    step = {options.growth * old.dt, StepLimit::kGrowth, -1};
  }
  return step;
}

}  // namespace shearbus::lagrange
