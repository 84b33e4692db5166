// Writes a map of pressures and velocities as two files: nodes.csv has one row per node and time of observation,
// map.json has axes, lines, scene and versions.
#pragma once

#include <filesystem>
#include <string>

#include "client/study/map/sweep.hpp"
#include "server/version.hpp"

namespace shearbus::map {

// Smallest share of the imposed slip that the layer must carry for the velocity-driven model to be valid. A server
// marks a step in which the layer carries less as outside the domain of validity.
inline constexpr double kDomainShare = 0.9;

void write(const Map& map, const std::string& scene_name, const server::Entries& provenance,
           const std::filesystem::path& out);

// Returns a summary of the map as text for the terminal.
std::string summary(const Map& map);

}  // namespace shearbus::map
