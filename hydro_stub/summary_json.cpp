#include "hydro_stub/summary_json.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

namespace shearbus::hydro {

nlohmann::ordered_json as_json(const wire::EnergyTotals& energy) {
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

SummaryLines layer_lines(const wire::EnergyTotals& energy) {
  if (energy.empty()) return {};
  constexpr double kRounding = 1e-12;
  const auto relative = [&](wire::Field residual, double whole) {
    return whole != 0.0 ? energy.mean(residual) / std::abs(whole) : energy.mean(residual);
  };
  const double heat = relative(wire::Field::kHeatResidual,
                               energy.mean(wire::Field::kHeatToSoft) + energy.mean(wire::Field::kHeatToHard));
  const double work = relative(wire::Field::kEnergyResidual, energy.mean(wire::Field::kInterfaceWork));
  SummaryLines lines = energy.lines();
  lines.back() = {"layer, residuals", fmt::format("heat {:.1e} of the heat; energy {:.1e} of the work", heat, work)};
  if (std::abs(work) > kRounding) {
    lines.emplace_back("",
                       "more than rounding: in a step that stops or turns the slip, work is that of the mean jump,");
    lines.emplace_back("", "heat that of the slip; the difference is of first order in the length of the step");
  }
  return lines;
}

SummaryLines regime_lines() {
  return {
      {"what limits friction", "Coulomb: friction coefficient times pressure; Tresca: strength of the softer metal;"},
      {"", "melting: that strength within 1 % of the melting temperature; stick: less stress holds"}};
}

}  // namespace shearbus::hydro
