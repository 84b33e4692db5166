#include "hydro_stub/lagrange/time_step.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

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

TimeStep next_time_step(const Mesh& mesh, const TimeStepOptions& options, const Geometry& geometry,
                        const std::vector<Vec2>& position, const std::vector<double>& sound_speed,
                        const std::vector<double>& viscous_rate, const std::vector<double>& dilatation,
                        const TimeStep& old) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  TimeStep courant{kNone, StepLimit::kCourant, -1};
  TimeStep volume{kNone, StepLimit::kVolumeChange, -1};
  for (int zone = 0; zone < mesh.num_zones(); ++zone) {
    const int* n = mesh.zone_nodes(zone);
    double longest = 0.0;
    for (int k = 0; k < 4; ++k) {
      const Vec2 edge = position[n[(k + 1) % 4]] - position[n[k]];
      longest = std::max(longest, dot(edge, edge));
    }
    const double width = geometry.area[zone] / std::sqrt(longest);
    const double b = viscous_rate[zone] * width;
    const double c = sound_speed[zone];
    const double speed = b + std::sqrt(b * b + c * c);
    if (options.cfl * width < courant.dt * speed) {
      courant.dt = options.cfl * width / speed;
      courant.zone = zone;
    }
    const double rate = std::abs(dilatation[zone]);
    if (options.volume_change < volume.dt * rate) {
      volume.dt = options.volume_change / rate;
      volume.zone = zone;
    }
  }
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
