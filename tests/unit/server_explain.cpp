// What a scene is said to pay for is what it pays for.
#include "server/explain.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <variant>

#include "tests/support/scenes.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::server {
namespace {

using ::testing::HasSubstr;

std::uint64_t bytes_of_session(const v1::Scene& scene) {
  support::ServiceHarness harness;
  const auto ids = support::node_ids(3);
  const support::Answer opened = harness.ask(support::ServiceHarness::opening(scene, ids));
  return std::get<wire::SessionOpened>(opened.reply.body).bytes_per_node;
}

const ScenePart& part(const Explanation& told, const std::string& name) {
  return *std::ranges::find(told.parts, name, &ScenePart::name);
}

TEST(Explain, MemoryIsThatOfASession) {
  v1::Scene scene = support::force_scene();
  const Explanation told = explain(scene);
  EXPECT_EQ(told.cost.bytes_per_node, bytes_of_session(scene));
  // What a part would take is what it takes once it is there.
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

TEST(Explain, AShadowIsPaidFor) {
  v1::Scene scene = support::force_scene();
  scene.mutable_layer()->set_heat(v1::HEAT_MODES);
  const Explanation without = explain(scene, false);
  scene.mutable_layer()->set_shadow_share(0.3);
  const Explanation with = explain(scene, false);
  EXPECT_EQ(with.cost.bytes_per_node, bytes_of_session(scene));
  const ScenePart& shadow = part(with, "layer.shadow_share");
  EXPECT_TRUE(shadow.on);
  EXPECT_EQ(shadow.bytes_per_node, static_cast<std::int64_t>(with.cost.bytes_per_node) -
                                       static_cast<std::int64_t>(without.cost.bytes_per_node));
  EXPECT_GT(shadow.slipping_s, 0.0);
  EXPECT_TRUE(part(with, "layer.heat = \"profile\"").excluded.empty());
}

TEST(Explain, WhatASceneCannotHaveIsSaidWithTheReason) {
  const Explanation forced = explain(support::force_scene());
  EXPECT_THAT(part(forced, "layer.inertia").excluded, HasSubstr("needs strategy velocity_driven"));
  EXPECT_THAT(forced.text(), HasSubstr("off layer.inertia"));
  const Explanation driven = explain(support::velocity_scene());
  EXPECT_TRUE(part(driven, "layer.inertia").excluded.empty());
  EXPECT_FALSE(part(driven, "junctions").excluded.empty());
}

TEST(Explain, TimesAreMeasured) {
  v1::Scene scene = support::velocity_scene(60);
  const Explanation told = explain(scene);
  for (const SceneCost& cost : {told.cost, told.everything}) {
    EXPECT_GT(cost.slipping_s, 1e-8);
    EXPECT_LT(cost.slipping_s, 1e-2);
    EXPECT_GT(cost.step_length_s, 0.0);
    EXPECT_LT(cost.resting_s, cost.slipping_s);
  }
  EXPECT_GT(told.everything.slipping_s, told.cost.slipping_s);
  EXPECT_THAT(told.text(10), HasSubstr("a step of 10 nodes"));
}

TEST(Explain, ARunIsToldWhatSlept) {
  v1::Scene scene = support::force_scene();
  EXPECT_EQ(spared(support::text_of(scene), {.node_steps = 10}, false).lines.size(), 1U);
  scene.mutable_layer()->set_sleep(true);
  scene.mutable_layer()->set_shadow_share(0.5);
  const auto [lines, json] = spared(
      support::text_of(scene),
      {.node_steps = 200, .asleep_node_steps = 50, .shadowed_node_steps = 20, .shadow_temperature_error_k = 3e-11},
      true);
  ASSERT_EQ(lines.size(), 3U);
  EXPECT_THAT(lines[0].second, HasSubstr("hard_layer"));
  EXPECT_THAT(lines[1].second, HasSubstr("25.0 %"));
  EXPECT_THAT(lines[2].second, HasSubstr("20 node-steps"));
  EXPECT_THAT(lines[2].second, HasSubstr("3.0e-11 K"));
  EXPECT_THAT(json, HasSubstr(R"("left_out": ["hard_layer", )"));
  EXPECT_THAT(json, HasSubstr(R"("share_asleep": 0.25, "shadowed_node_steps": 20)"));
}

}  // namespace
}  // namespace shearbus::server
