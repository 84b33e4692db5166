// JSON objects that occur in the summaries of both one- and two-dimensional runs.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "hydro_stub/interface_law.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {

nlohmann::ordered_json as_json(const wire::EnergyTotals& energy);  // each energy as the mean over the nodes  [J/m2]
nlohmann::ordered_json as_json(const OmittedCost& omitted);
nlohmann::ordered_json as_json(const server::Entries& entries);

}  // namespace shearbus::hydro
