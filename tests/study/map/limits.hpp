// Lines of a map: limiting velocities at each pressure.
#pragma once

#include <optional>
#include <vector>

#include "tests/study/map/sweep.hpp"

namespace shearbus::map {

// A velocity for each pressure; empty if the limit lies outside the velocities of the map.
using Line = std::vector<std::optional<double>>;

// Returns the share of the imposed slip that the layer has carried: 1 minus the elastic part, h s / (G0 V t).
std::vector<double> slip_share(const Map& map, const Observation& seen);

// Returns the velocity at which the layer carries this share of the imposed slip; below it the velocity-driven model is
// outside its domain. A share of 0 gives the velocity below which the layer sticks although slip is imposed.
Line velocity_of_share(const Map& map, const Observation& seen, double share);

// Returns the lowest velocity jump that has melted the interface by that time.
Line velocity_of_melting(const Map& map, double time_s);

}  // namespace shearbus::map
