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
                        double thinnest) {
  if (!has_first) return {.first = widest, .growth = growth, .widest = widest};
  if (!(first <= widest))
    refuse(table + ".first_zone_m",
           fmt::format("{}.first_zone_m = {} m is more than the other zones' {} m", table, first, widest),
           "zones grow away from the interface: lower first_zone_m");
  if (!(2.0 * first <= thinnest))
    refuse(table + ".first_zone_m",
           fmt::format("{}.first_zone_m = {} m does not go twice into the thinnest body, {} m", table, first, thinnest),
           "lower first_zone_m");
  // Zones that do not grow fill the whole body: the number of zones is checked by the caller only for zone_width_m.
  constexpr double kMostAcross = 1e5;
  if (growth == 1.0 && first < widest && thinnest / first > kMostAcross)
    refuse(table + ".zone_growth",
           fmt::format("{}.zone_growth = 1 makes {:.3g} zones of first_zone_m = {} m across the thinnest body", table,
                       thinnest / first, first),
           "raise zone_growth, usually to 1.1 to 1.3");
  return {.first = first, .growth = growth, .widest = widest};
}

}  // namespace shearbus::hydro
