#include "proto/wire/energy_totals.hpp"

#include <fmt/format.h>

#include <algorithm>
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
  const auto of = [this](Field term) { return fmt::format("{:.6g}", mean(term)); };
  return {{"layer, energy",
           fmt::format("work {}; heat to soft {}, to hard {}; plastic work {}; elastic {} J/m2, mean of nodes",
                       of(Field::kInterfaceWork), of(Field::kHeatToSoft), of(Field::kHeatToHard),
                       of(Field::kPlasticWork), of(Field::kElasticEnergy))},
          {"layer, stored heat",
           fmt::format("soft {}, hard {} J/m2", of(Field::kStoredHeatSoft), of(Field::kStoredHeatHard))},
          {"layer, residuals",
           fmt::format("heat {:.1e}, energy {:.1e} J/m2", mean(Field::kHeatResidual), mean(Field::kEnergyResidual))}};
}

}  // namespace shearbus::wire
