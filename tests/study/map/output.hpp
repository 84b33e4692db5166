// A map on disk: nodes.csv, one row per node and observation; map.json, axes, lines and where it all comes from.
#pragma once

#include <filesystem>
#include <string>

#include "tests/study/map/sweep.hpp"

namespace shearbus::map {

inline constexpr double kDomainShare = 0.9;  // of the imposed slip, as the server's outcome judges each step

void write(const Map& map, const std::string& scene_name, const std::string& version, const std::filesystem::path& out);

// What a person wants to know without opening it.
std::string summary(const Map& map);

}  // namespace shearbus::map
