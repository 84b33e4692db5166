// JSON objects and lines that occur in the summaries of both one- and two-dimensional runs.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {

nlohmann::ordered_json as_json(const files::EnergyTotals& energy);  // each energy as the mean over the nodes  [J/m2]
nlohmann::ordered_json as_json(const OmittedCost& omitted);
nlohmann::ordered_json as_json(const server::Entries& entries);

using SummaryLines = std::vector<std::pair<std::string, std::string>>;  // lines of a summary, each with label and text
// Returns the lines that explain the names of the regimes: what limits the friction in each of them.
SummaryLines regime_lines();

}  // namespace shearbus::hydro
