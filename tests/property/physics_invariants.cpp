// Checks the invariants of server/physics/MODEL.md, "What always holds", for random scenes, states and inputs.
#include <gtest/gtest.h>

#include <cctype>
#include <cstdio>
#include <string>
#include <tuple>

#include "tests/campaign/random.hpp"

namespace shearbus::study::stability {

void PrintTo(const RandomKind& kind, std::ostream* os) {
  *os << kind.name;
}

namespace {

constexpr long kNodeSteps = 24000;
constexpr long kExtremeNodeSteps = 36000;  // larger than kNodeSteps, because extreme scenes rarely reach some regimes

class PhysicsInvariants : public ::testing::TestWithParam<std::tuple<RandomKind, bool>> {};

TEST_P(PhysicsInvariants, HoldForRandomScenesStatesAndInputs) {
  const auto& [kind, extreme] = GetParam();
  const RandomOutcome outcome = run_random(kind, extreme, extreme ? kExtremeNodeSteps : kNodeSteps, 2024);
  for (const RandomOutcome::Fault& fault : outcome.faults) ADD_FAILURE() << "seed " << fault.seed << ": " << fault.text;
  const Figures& figures = outcome.figures;
  using testing::Regime;
  std::printf(
      "%ld node-steps: stick %ld, coulomb %ld, tresca %ld, melting %ld, divided %ld; %ld of %ld layers held to (64); "
      "heat balance %.1e\n",
      figures.node_steps, figures.regime(Regime::kStick), figures.regime(Regime::kCoulomb),
      figures.regime(Regime::kTresca), figures.regime(Regime::kMelting), figures.divided, figures.flowing_resolved,
      figures.flowing, figures.heat_residual);
  EXPECT_GE(10 * figures.flowing_resolved, 6 * figures.flowing);
  // The random steps must reach every regime of a closed contact, or the invariants of a regime would not be tested.
  for (const Regime regime : {Regime::kStick, Regime::kCoulomb, Regime::kTresca, Regime::kMelting})
    EXPECT_GT(figures.regime(regime), 100);
}

std::string test_name(const ::testing::TestParamInfo<std::tuple<RandomKind, bool>>& test) {
  std::string name;
  for (bool start = true; const char c : std::string(std::get<0>(test.param).name)) {
    const bool letter = std::isalpha(static_cast<unsigned char>(c)) != 0;
    if (letter) name += start ? static_cast<char>(std::toupper(static_cast<unsigned char>(c))) : c;
    start = !letter;
  }
  return name + (std::get<1>(test.param) ? "Extreme" : "");
}

INSTANTIATE_TEST_SUITE_P(, PhysicsInvariants,
                         ::testing::Combine(::testing::ValuesIn(random_kinds().begin(), random_kinds().end()),
                                            ::testing::Bool()),
                         test_name);

}  // namespace
}  // namespace shearbus::study::stability
