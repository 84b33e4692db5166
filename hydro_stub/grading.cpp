#include "hydro_stub/grading.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "hydro_stub/problem.hpp"

namespace shearbus::hydro {

GradedNodes graded_nodes(double length, const Grading& grading) {
  GradedNodes nodes{.distance = {0.0}, .graded = 0};
  double thickness = grading.first;
  while (thickness < grading.widest && nodes.distance.back() + 3.0 * thickness <= length) {
    nodes.distance.push_back(nodes.distance.back() + thickness);
    ++nodes.graded;
    if (grading.growth == 1.0) continue;
    thickness = std::min(grading.growth * thickness, grading.widest);
  }
  if (nodes.graded ==
      0) {  // all zones have the widest thickness; the first one keeps exactly the one that was asked for
    nodes.distance.push_back(grading.first);
    nodes.graded = 1;
  }
  const double begin = nodes.distance.back();
  const double rest = length - begin;
  const int equal = std::max(1, static_cast<int>(std::lround(rest / std::min(thickness, grading.widest))));
  for (int k = 1; k < equal; ++k) nodes.distance.push_back(begin + rest * k / equal);
  nodes.distance.push_back(length);
  return nodes;
}

Grading checked_grading(const std::string& table, bool has_first, double first, double growth, double widest,
                        double longest) {
  if (!has_first) return {.first = widest, .growth = growth, .widest = widest};
  if (!(first <= widest))
    refuse(table + ".first_zone_m",
           fmt::format("{}.first_zone_m = {} m is more than the other zones' {} m", table, first, widest),
           "zones grow away from the interface: lower first_zone_m");
  constexpr double kMostZones = 1e5;
  const double to_fill = longest / first;
  const double zones = growth > 1.0 ? std::min(to_fill, std::log(widest / first) / std::log(growth)) : to_fill;
  if (first < widest && zones > kMostZones)
    refuse(table + ".zone_growth",
           fmt::format("{}.zone_growth = {} makes {:.3g} zones across a body of {} m, at most {:g} are allowed", table,
                       growth, zones, longest, kMostZones),
           "raise zone_growth, usually to 1.1 to 1.3, or first_zone_m");
  return {.first = first, .growth = growth, .widest = widest};
}

}  // namespace shearbus::hydro
