// Lines in the map of pressures and velocities: each gives a limiting velocity for every pressure.
#pragma once

#include <optional>
#include <vector>

#include "client/study/map/sweep.hpp"

namespace shearbus::map {

// A velocity for each pressure. A value is absent if the limit lies outside the velocities of the map.
using Line = std::vector<std::optional<double>>;

// Returns for each node the share of the imposed slip V t that the layer has carried plastically. The rest of the slip
// is elastic, a share of h s / (G0 V t).
std::vector<double> slip_share(const Map& map, const Observation& seen);

// Returns for each pressure the velocity jump above which the layer carries more than `share` of the imposed slip. For
// the share kDomainShare this is the lowest velocity at which the velocity-driven model is valid. For the share 0 it is
// the velocity below which the layer sticks although slip is imposed.
Line velocity_of_share(const Map& map, const Observation& seen, double share);

// Returns for each pressure the lowest velocity jump that has melted the interface by the time `time_s`.
Line velocity_of_melting(const Map& map, double time_s);

}  // namespace shearbus::map
