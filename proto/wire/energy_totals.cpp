#include "proto/wire/energy_totals.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace shearbus::wire {

void EnergyTotals::add(const Batch& upscale) {
  for (std::size_t i = 0; i < kLedgerColumns.size(); ++i) {
    const auto column = upscale.f64(kLedgerColumns[i]);
    if (column.empty()) continue;
    numbers_.back() = static_cast<double>(column.size());
    numbers_[i] = std::accumulate(column.begin(), column.end(), numbers_[i]);
  }
}

void EnergyTotals::add(const EnergyTotals& step) {
  for (std::size_t i = 0; i < kLedgerColumns.size(); ++i) numbers_[i] += step.numbers_[i];
  numbers_.back() = std::max(numbers_.back(), step.numbers_.back());
}

double EnergyTotals::mean(Field term) const {
  const auto at = std::find(kLedgerColumns.begin(), kLedgerColumns.end(), term) - kLedgerColumns.begin();
  return empty() ? 0.0 : numbers_[static_cast<std::size_t>(at)] / numbers_.back();
}

std::vector<std::pair<std::string, std::string>> EnergyTotals::lines() const {
  if (empty()) return {};
  constexpr double kRounding = 1e-12;
  const auto relative = [this](Field residual, double whole) {
    return whole != 0.0 ? mean(residual) / std::abs(whole) : mean(residual);
  };
  const double heat = relative(Field::kHeatResidual, mean(Field::kHeatToSoft) + mean(Field::kHeatToHard));
  const double work = relative(Field::kEnergyResidual, mean(Field::kInterfaceWork));
  const auto of = [this](Field term) { return fmt::format("{:.6g}", mean(term)); };
  std::vector<std::pair<std::string, std::string>> lines = {
      {"layer, energy",
       fmt::format("work {}; heat to soft {}, to hard {}; plastic work {}; elastic {} J/m2, mean of nodes",
                   of(Field::kInterfaceWork), of(Field::kHeatToSoft), of(Field::kHeatToHard), of(Field::kPlasticWork),
                   of(Field::kElasticEnergy))},
      {"layer, stored heat",
       fmt::format("soft {}, hard {} J/m2", of(Field::kStoredHeatSoft), of(Field::kStoredHeatHard))},
      {"layer, residuals", fmt::format("heat {:.1e} of the heat; energy {:.1e} of the work", heat, work)}};
  if (std::abs(work) > kRounding) {
    lines.emplace_back("", "more than rounding: elastic work that heats; in a step that stops or turns the slip the");
    lines.emplace_back("", "work is that of the mean jump, the heat that of the slip (METHODS.md, Energy ledger)");
  }
  return lines;
}

}  // namespace shearbus::wire
