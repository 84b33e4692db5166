// Lines of a map: the velocity at which something changes, for each pressure.
#pragma once

#include <optional>
#include <vector>

#include "tests/study/map/sweep.hpp"

namespace shearbus::map {

// A line over the pressures. Nothing where the change lies outside the velocities of the map.
using Line = std::vector<std::optional<double>>;

// Share of the imposed slip that the layer has carried until the observation: 1 less what is elastic, h s / (G0 V t).
std::vector<double> slip_share(const Map& map, const Observation& seen);

// Where the layer carries this share of the imposed slip: below, a velocity-driven answer is outside its domain. 0:
// where it carries the first slip at all, so that below it sticks although slip is imposed.
Line velocity_of_share(const Map& map, const Observation& seen, double share);

// The slowest jump that has melted the interface by then.
Line velocity_of_melting(const Map& map, double time_s);

}  // namespace shearbus::map
