// Writes a map: nodes.csv with one row per node and observation, map.json with axes, lines, scene and versions.
#pragma once

#include <filesystem>
#include <string>

#include "tests/study/map/sweep.hpp"

namespace shearbus::map {

// Share of the imposed slip, the same limit as in the server's outcome of each step.
inline constexpr double kDomainShare = 0.9;

void write(const Map& map, const std::string& scene_name, const std::string& version, const std::filesystem::path& out);

// Returns the printed summary.
std::string summary(const Map& map);

}  // namespace shearbus::map
