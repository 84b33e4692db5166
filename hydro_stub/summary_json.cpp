#include "hydro_stub/summary_json.hpp"

#include <nlohmann/json.hpp>

namespace shearbus::hydro {

nlohmann::ordered_json as_json(const files::EnergyTotals& energy) {
  nlohmann::ordered_json out;
  for (const wire::Field term : wire::kLedgerColumns) out[name(term)] = energy.mean(term);
  return out;
}

nlohmann::ordered_json as_json(const OmittedCost& omitted) {
  nlohmann::ordered_json out = {{"parts", omitted.parts},
                                {"bytes_per_node", omitted.bytes_per_node},
                                {"bytes_per_node_with_everything", omitted.bytes_per_node_with_everything}};
  if (omitted.share_asleep) out["share_asleep"] = *omitted.share_asleep;
  return out;
}

nlohmann::ordered_json as_json(const server::Entries& entries) {
  nlohmann::ordered_json out;
  for (const auto& [key, value] : entries) out[key] = value;
  return out;
}

SummaryLines regime_lines() {
  return {
      {"what limits friction", "Coulomb: friction coefficient times pressure; Tresca: strength of the softer metal;"},
      {"", "melting: that strength within 1 % of the melting temperature; stick: less stress holds"}};
}

}  // namespace shearbus::hydro
