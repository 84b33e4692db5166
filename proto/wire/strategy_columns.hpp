// Which columns a step of each strategy is asked with and answered by: the one table behind requests, validation and
// replies.
#pragma once

#include <algorithm>
#include <array>
#include <span>

#include "proto/wire/batch.hpp"

namespace shearbus::wire {

// Same numbers as shearbus.v1.Strategy, where they are explained.
enum class Strategy { kUnspecified = 0, kVelocityDriven = 1, kForceDriven = 2 };

struct StrategyColumns {
  std::span<const Field> required;  // of a downscale, besides the optional node_id
  std::span<const Field> optional;
  std::span<const Field> reply;  // a request's `wanted` picks from them and from kColumnsOnRequest; empty: these
};

// The energy ledger of a step: columns of any reply, but only where a request names them. In the order of physics'
// LedgerTerm.
inline constexpr std::array kLedgerColumns = {Field::kInterfaceWork, Field::kHeatToSoft,     Field::kHeatToHard,
                                              Field::kPlasticWork,   Field::kStoredHeatSoft, Field::kStoredHeatHard,
                                              Field::kElasticEnergy, Field::kHeatResidual,   Field::kEnergyResidual};

// All columns that are answered only where a request names them.
inline constexpr auto kColumnsOnRequest = [] {
  std::array<Field, kLedgerColumns.size() + 1> columns{};
  std::copy(kLedgerColumns.begin(), kLedgerColumns.end(), columns.begin());
  columns.back() = Field::kErrorEstimate;
  return columns;
}();

namespace detail {
inline constexpr std::array kVelocityRequired = {Field::kVelocityJump, Field::kPressure};
inline constexpr std::array kVelocityOptional = {Field::kSoftShearRate};
inline constexpr std::array kVelocityReply = {
    Field::kShearStress,  Field::kSlidingVelocity, Field::kInterfaceTemperature,
    Field::kFrictionHeat, Field::kRegime,          Field::kOutcome};
inline constexpr std::array kForceRequired = {Field::kVelocityJump, Field::kPressure,  Field::kStressMinus,
                                              Field::kStressPlus,   Field::kMassMinus, Field::kMassPlus};
inline constexpr std::array kForceOptional = {Field::kSoftPlasticStrainRate};
inline constexpr std::array kForceReply = {
    Field::kShearStress,     Field::kSlidingVelocity, Field::kInterfaceTemperature,
    Field::kVelocityJumpNew, Field::kFrictionHeat,    Field::kRegime,
    Field::kOutcome};
}  // namespace detail

inline StrategyColumns columns_of(Strategy strategy) {
  switch (strategy) {
    case Strategy::kVelocityDriven:
      return {detail::kVelocityRequired, detail::kVelocityOptional, detail::kVelocityReply};
    case Strategy::kForceDriven:
      return {detail::kForceRequired, detail::kForceOptional, detail::kForceReply};
    case Strategy::kUnspecified:
      break;
  }
  return {};
}

}  // namespace shearbus::wire
