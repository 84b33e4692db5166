#include "proto/files/energy_totals.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace shearbus::files {

void EnergyTotals::add(const wire::Batch& upscale) {
  for (const wire::Field term : wire::kLedgerColumns) add(term, upscale.f64(term));
}

void EnergyTotals::add(wire::Field term, std::span<const double> values) {
  if (values.empty()) return;
  const auto at = std::ranges::find(wire::kLedgerColumns, term) - wire::kLedgerColumns.begin();
  double& sum = numbers_[static_cast<std::size_t>(at)];
  numbers_.back() = static_cast<double>(values.size());
  sum = std::accumulate(values.begin(), values.end(), sum);
}

void EnergyTotals::add(const EnergyTotals& step) {
  for (std::size_t i = 0; i < wire::kLedgerColumns.size(); ++i) numbers_[i] += step.numbers_[i];
  numbers_.back() = std::max(numbers_.back(), step.numbers_.back());
}

double EnergyTotals::mean(wire::Field term) const {
  const auto at =
      std::find(wire::kLedgerColumns.begin(), wire::kLedgerColumns.end(), term) - wire::kLedgerColumns.begin();
  return empty() ? 0.0 : numbers_[static_cast<std::size_t>(at)] / numbers_.back();
}

std::vector<std::pair<std::string, std::string>> EnergyTotals::lines() const {
  if (empty()) return {};
  constexpr double kRounding = 1e-12;
  const auto relative = [this](wire::Field residual, double whole) {
    return whole != 0.0 ? mean(residual) / std::abs(whole) : mean(residual);
  };
  const double heat =
      relative(wire::Field::kHeatResidual, mean(wire::Field::kHeatToSoft) + mean(wire::Field::kHeatToHard));
  const double work = relative(wire::Field::kEnergyResidual, mean(wire::Field::kInterfaceWork));
  const auto of = [this](wire::Field term) { return fmt::format("{:.6g}", mean(term)); };
  std::vector<std::pair<std::string, std::string>> lines = {
      {"layer, energy",
       fmt::format("work {}; heat to soft {}, to hard {}; plastic work {}; elastic {} J/m2, mean of nodes",
                   of(wire::Field::kInterfaceWork), of(wire::Field::kHeatToSoft), of(wire::Field::kHeatToHard),
                   of(wire::Field::kPlasticWork), of(wire::Field::kElasticEnergy))},
      {"layer, stored heat",
       fmt::format("soft {}, hard {} J/m2", of(wire::Field::kStoredHeatSoft), of(wire::Field::kStoredHeatHard))},
      {"layer, residuals", fmt::format("heat {:.1e} of the heat; energy {:.1e} of the work", heat, work)}};
  if (std::abs(work) > kRounding) {
    lines.emplace_back("", "more than rounding: elastic work that heats; in a step that stops or turns the slip the");
    lines.emplace_back("", "work is that of the mean jump, the heat that of the slip (METHODS.md, Energy ledger)");
  }
  return lines;
}

}  // namespace shearbus::files
