// JSON objects and lines that occur in the summaries of both one- and two-dimensional runs.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {

nlohmann::ordered_json as_json(const wire::EnergyTotals& energy);  // each energy as the mean over the nodes  [J/m2]
nlohmann::ordered_json as_json(const OmittedCost& omitted);
nlohmann::ordered_json as_json(const server::Entries& entries);

// Lines of a summary, each with label and text. Below: the energies of the layers, with the residuals of their balances
// relative to what is balanced; empty for a law without layers.
using SummaryLines = std::vector<std::pair<std::string, std::string>>;
SummaryLines layer_lines(const wire::EnergyTotals& energy);
// What limits the friction in each regime, for readers who do not know the names of the regimes.
SummaryLines regime_lines();

}  // namespace shearbus::hydro
