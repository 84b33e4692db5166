// Tests that run with both strategies:
//
//   INSTANTIATE_TEST_SUITE_P(Strategies, Suite, support::both<Strategy>(), support::name_of_strategy);
#pragma once

#include <gtest/gtest.h>

#include <string>

namespace shearbus::support {

template <class Strategy>
auto both() {
  return ::testing::Values(Strategy::kVelocityDriven, Strategy::kForceDriven);
}

inline constexpr auto name_of_strategy = []<class Strategy>(const ::testing::TestParamInfo<Strategy>& test) {
  return std::string(test.param == Strategy::kVelocityDriven ? "VelocityDriven" : "ForceDriven");
};

}  // namespace shearbus::support
