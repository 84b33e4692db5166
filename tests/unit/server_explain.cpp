// `shearbus-server explain` must report the memory and the parts that a session with the scene really has.
#include "server/explain.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <ranges>
#include <string>
#include <variant>

#include "tests/support/scenes.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

Explanation explain(const v1::Scene& scene) {
  return server::explain(support::text_of(scene), "scene");
}

std::uint64_t bytes_of_session(const v1::Scene& scene) {
  support::ServiceHarness harness;
  const auto ids = support::node_ids(3);
  const support::Answer opened = harness.ask(support::ServiceHarness::opening(scene, ids));
  return std::get<wire::SessionOpened>(opened.reply.body).bytes_per_node;
}

const ScenePart& part(const Explanation& told, const std::string& name) {
  return *std::ranges::find(told.parts, name, &ScenePart::name);
}

// True if one of five measurements shows it. What else the machine does can disturb some of them.
template <typename Measured>
bool seen(const Measured& measured) {
  const auto measurements = std::views::iota(0, 5);
  return std::ranges::any_of(measurements, [&](int) { return measured(); });
}

TEST(Explain, MemoryIsThatOfASession) {
  v1::Scene scene = support::force_scene();
  const Explanation told = explain(scene);
  EXPECT_EQ(told.cost.bytes_per_node, bytes_of_session(scene));
  // For a part that the scene lacks, `explain` must report the memory that adding this part costs.
  const std::int64_t without = static_cast<std::int64_t>(bytes_of_session(scene));
  const std::int64_t would = part(told, "hard_layer").bytes_per_node;
  scene.mutable_hard_layer();
  EXPECT_EQ(static_cast<std::int64_t>(bytes_of_session(scene)), without + would);
  const Explanation with = explain(scene);
  EXPECT_TRUE(part(with, "hard_layer").on);
  EXPECT_EQ(part(with, "hard_layer").bytes_per_node, would);
  EXPECT_GT(would, 0);
  EXPECT_GT(with.everything.bytes_per_node, with.cost.bytes_per_node);
}

TEST(Explain, MemoryCountsTheSumsOfTheFrictionEnergy) {
  for (v1::Scene scene : {support::force_scene(), support::velocity_scene()}) {
    const Explanation without = explain(scene);
    EXPECT_FALSE(part(without, "friction_energy").on);
    EXPECT_EQ(part(without, "friction_energy").bytes_per_node, 32);
    scene.set_friction_energy(true);
    const Explanation with = explain(scene);
    EXPECT_TRUE(part(with, "friction_energy").on);
    EXPECT_EQ(with.cost.bytes_per_node, without.cost.bytes_per_node + 32);
    EXPECT_EQ(with.cost.bytes_per_node, bytes_of_session(scene));
    EXPECT_EQ(with.everything.bytes_per_node, without.everything.bytes_per_node);
    EXPECT_EQ(omitted_cost(support::text_of(scene), {}).bytes_per_node, bytes_of_session(scene));
  }
}

TEST(Explain, WhatASceneCannotHaveIsSaidWithTheReason) {
  const Explanation forced = explain(support::force_scene());
  EXPECT_THAT(part(forced, "layer.inertia").excluded, HasSubstr("a layer that is rigid moves with the soft body"));
  EXPECT_THAT(forced.text(), HasSubstr("off layer.inertia"));
  EXPECT_THAT(part(forced, "velocity_driven.drive").excluded, HasSubstr("is an option of strategy"));
  const Explanation driven = explain(support::velocity_scene());
  EXPECT_TRUE(part(driven, "layer.inertia").excluded.empty());
  EXPECT_TRUE(part(driven, "junctions").excluded.empty());
  EXPECT_FALSE(part(driven, "melt_film").excluded.empty());
  EXPECT_THAT(part(forced, "melt_film").excluded, HasSubstr("[melt_film] needs [hard_layer]: the fixed share"));
}

TEST(Explain, TheLinearisedAnswerHasAPriceWhereThereIsOne) {
  v1::Scene scene = support::velocity_scene(60);
  const Explanation told = explain(scene);
  EXPECT_EQ(part(told, "linearised answer").bytes_per_node, 24);
  EXPECT_FALSE(part(told, "linearised answer").on);
  EXPECT_TRUE(seen([&] { return part(explain(scene), "linearised answer").slipping.median_s > 0.0; }));
  scene.mutable_layer()->set_inertia(true);
  const Explanation with = explain(scene);
  EXPECT_THAT(part(with, "friction_energy").excluded, HasSubstr("energy ledger"));
  EXPECT_TRUE(std::ranges::none_of(with.parts, [](const auto& one) { return one.name == "linearised answer"; }));
}

TEST(Explain, PairsAreNamed) {
  const std::string scene = support::text_of(support::force_scene());
  EXPECT_THAT(server::explain(scene, "scene").text(), Not(HasSubstr("  pairs")));
  EXPECT_THAT(server::explain(scene + "\n[pair.lead.soft]\nmaterial = \"aluminium_dlp\"\n", "scene").text(),
              HasSubstr("  pairs               of the tables outside [pair]; the nodes of lead "));
}

TEST(Explain, NoLineIsWiderThanATerminal) {
  for (const v1::Scene& scene : {support::force_scene(), support::velocity_scene()}) {
    const std::string text = explain(scene).text(10);
    std::ptrdiff_t widest = 0;
    for (std::size_t begin = 0, end = 0; (end = text.find('\n', begin)) != std::string::npos; begin = end + 1)
      widest = std::max(widest, std::ranges::count_if(text.substr(begin, end - begin), [](char c) {
                          return (c & 0xc0) != 0x80;  // the first byte of a character in UTF-8
                        }));
    EXPECT_LE(widest, 100) << text;
    EXPECT_GT(widest, 80) << text;
  }
  // A long reason continues below its beginning, and no word of it is lost.
  const Explanation forced = explain(support::force_scene());
  const std::string reason = part(forced, "layer.inertia").excluded;
  ASSERT_GT(reason.size(), 100U);
  std::string text = forced.text();
  std::string margin(47, ' ');
  margin.front() = '\n';
  EXPECT_THAT(text, HasSubstr(margin));
  for (std::size_t at = 0; (at = text.find(margin, at)) != std::string::npos;) {
    text.erase(at, margin.size() - 1);  // leaves one space of the margin
  }
  EXPECT_THAT(text, HasSubstr(reason + '\n'));
}

TEST(Explain, TimesAreMeasured) {
  v1::Scene scene = support::velocity_scene(60);
  const Explanation told = explain(scene);
  for (const SceneCost& cost : {told.cost, told.everything}) {
    EXPECT_GT(cost.slipping_s, 1e-8);
    EXPECT_LT(cost.slipping_s, 1e-2);
    EXPECT_GT(cost.step_length_s, 0.0);
  }
  EXPECT_TRUE(seen([&] {
    const Explanation again = explain(scene);
    return again.everything.slipping_s > again.cost.slipping_s && again.cost.resting_s < again.cost.slipping_s &&
           again.everything.resting_s < again.everything.slipping_s;
  }));
  EXPECT_THAT(told.text(10), HasSubstr("a step of 10 nodes"));
}

TEST(Explain, ADifferenceWithinTheNoiseIsNotReportedAsAPrice) {
  EXPECT_FALSE(difference_of({-3, -2, -1, 0, 1, 2, 3}).is_measured());
  EXPECT_FALSE(difference_of({-1, 1, 1, 1, 1, 1}).is_measured()) << "of six samples all must agree";
  const TimeDifference six = difference_of({3e-7, 1e-7, 2e-7, 4e-7, 2e-7, 3e-7});
  EXPECT_TRUE(six.is_measured());
  EXPECT_DOUBLE_EQ(six.median_s, 2.5e-7);
  EXPECT_DOUBLE_EQ(six.low_s, 1e-7);
  EXPECT_DOUBLE_EQ(six.high_s, 4e-7);
  EXPECT_EQ(six.text(), "0.25 µs more (0.10 to 0.40)");
  const TimeDifference fifteen = difference_of({-9, -8, -7, 1, 1, 1, 1, 1, 1, 1, 1, 1, 7, 8, 9});
  EXPECT_DOUBLE_EQ(fifteen.low_s, 1.0) << "three of fifteen are left out on each side";
  EXPECT_DOUBLE_EQ(fifteen.high_s, 1.0);
  EXPECT_EQ(difference_of(std::vector<double>(7, -1e-6)).text(), "1.00 µs less (1.00 to 1.00)");
  EXPECT_EQ(difference_of({-4e-8, -2e-8, -1e-8, 0, 1e-8, 2e-8, 3e-8}).text(),
            "a time too small to measure here (below 0.04 µs)");
}

TEST(Explain, ALayerInTheOtherBodyHasAPrice) {
  EXPECT_TRUE(seen([] {
    const TimeDifference price = part(explain(support::force_scene()), "hard_layer").slipping;
    return price.is_measured() && price.median_s > 0.0;
  }));
}

TEST(OmittedCost, NamesTheMissingPartsTheirMemoryAndTheShareAsleep) {
  v1::Scene scene = support::force_scene();
  const OmittedCost awake = omitted_cost(support::text_of(scene), {.node_steps = 10});
  EXPECT_EQ(awake.lines().size(), 1U);
  EXPECT_FALSE(awake.share_asleep);
  EXPECT_EQ(awake.bytes_per_node, bytes_of_session(scene));
  EXPECT_EQ(awake.bytes_per_node_with_everything, explain(scene).everything.bytes_per_node);
  scene.mutable_layer()->set_sleep(true);
  const OmittedCost omitted = omitted_cost(support::text_of(scene), {.node_steps = 200, .asleep_node_steps = 50});
  ASSERT_FALSE(omitted.parts.empty());
  EXPECT_EQ(omitted.parts.front(), "hard_layer");
  EXPECT_EQ(omitted.share_asleep, 0.25);
  const auto lines = omitted.lines();
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_THAT(lines[0].second, HasSubstr("hard_layer"));
  EXPECT_THAT(lines[1].second, HasSubstr("25.0 %"));
}

TEST(OmittedCost, IsTheSameInEveryRun) {
  const v1::Scene scene = support::velocity_scene(60);
  EXPECT_EQ(omitted_cost(support::text_of(scene), {}).lines(), omitted_cost(support::text_of(scene), {}).lines());
}

}  // namespace
}  // namespace shearbus::server
