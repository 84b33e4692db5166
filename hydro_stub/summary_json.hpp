// JSON objects that the summaries of one and of two dimensions share.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "hydro_stub/interface_law.hpp"

namespace shearbus::hydro {

nlohmann::ordered_json as_json(const wire::EnergyTotals& energy);  // energies as means over the nodes  [J/m2]
nlohmann::ordered_json as_json(const OmittedCost& omitted);

}  // namespace shearbus::hydro
