// Force-driven layers with inertia, as a service takes their steps: whose mass is not taken from the host's is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <span>

#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

const std::vector<std::uint64_t> kNodes = support::node_ids(11);

v1::Scene waves() {
  v1::Scene scene = support::force_scene();
  scene.mutable_interface()->set_plastic_layer(true);
  scene.mutable_layer()->set_inertia(true);
  return scene;
}

wire::Batch closed(int step, std::span<const std::uint64_t> nodes = kNodes) {
  wire::Batch batch = support::step_columns(Strategy::kForceDriven, nodes, step, nodes.size() < kNodes.size());
  std::ranges::fill(batch.f64(Field::kPressure), 5e9);
  std::ranges::fill(batch.f64(Field::kMassSoft), 0.1);
  return batch;
}

TEST(ServiceInertia, ASoftHalfZoneNoHeavierThanItsLayerIsRefusedAndChangesNothing) {
  ServiceHarness harness, twin;
  for (ServiceHarness* h : {&harness, &twin}) {
    h->granted(ServiceHarness::opening(waves(), kNodes));
    h->granted(ServiceHarness::step(1, closed(1)));
  }
  wire::Batch light = closed(2);
  light.f64(Field::kMassSoft)[4] = 0.054;  // 20 um of aluminium have 0.05406
  light.f64(Field::kMassSoft)[6] = 1e-3;
  light.f64(Field::kMassSoft)[7] = 1e-3;
  light.f64(Field::kPressure)[7] = -1.0;  // an open contact takes no mass from it
  const Answer refused = harness.ask(ServiceHarness::step(2, std::move(light)));
  EXPECT_EQ(refused.code(), Code::kInvalidValue);
  EXPECT_EQ(refused.reply.status.field, "mass_soft_kg_per_m2");
  EXPECT_THAT(refused.reply.status.node_ids, ElementsAre(kNodes[4], kNodes[6]));
  EXPECT_THAT(refused.reply.status.text, HasSubstr("is 0.054; expected above 0.05406"));
  EXPECT_THAT(refused.reply.status.text, HasSubstr("(2 of 11 rows at fault)"));
  EXPECT_THAT(refused.reply.status.remedy, HasSubstr("layer.thickness_m"));
  wire::Batch of_nothing = closed(2);
  of_nothing.f64(Field::kMassHard)[3] = 1e-30;
  const Answer lost = harness.ask(ServiceHarness::step(2, std::move(of_nothing)));
  EXPECT_EQ(lost.code(), Code::kInvalidValue);
  EXPECT_EQ(lost.reply.status.field, "mass_hard_kg_per_m2");
  EXPECT_THAT(lost.reply.status.node_ids, ElementsAre(kNodes[3]));
  const Answer answer = harness.granted(ServiceHarness::step(2, closed(2)));
  EXPECT_EQ(answer.payload(), twin.ask(ServiceHarness::step(2, closed(2))).payload()) << "the refusal changed nothing";
}

// A part of a step whose half zone is too light is refused alone: the step goes on with the mended part, and has the bits of
// the undivided one.
TEST(ServiceInertia, ALightHalfZoneInAPartOfAStepIsRefusedAndTheStepGoesOn) {
  ServiceHarness harness, whole;
  for (ServiceHarness* h : {&harness, &whole})
    ASSERT_TRUE(h->ask(ServiceHarness::opening(waves(), kNodes)).reply.status.ok());
  const Answer undivided = whole.ask(ServiceHarness::step(1, closed(1)));
  ASSERT_TRUE(undivided.reply.status.ok());
  const auto part = [&](std::uint32_t number, wire::Batch batch) {
    wire::Request request = ServiceHarness::step(number, std::move(batch));
    std::get<wire::Downscale>(request.body).part = number;
    std::get<wire::Downscale>(request.body).parts = 2;
    return harness.ask(request);
  };
  constexpr std::size_t kFirst = 5;
  const auto first = std::span(kNodes).first(kFirst), rest = std::span(kNodes).subspan(kFirst);
  const Answer one = part(1, closed(1, first));
  ASSERT_TRUE(one.reply.status.ok());
  wire::Batch light = closed(1, rest);
  light.f64(Field::kMassSoft)[2] = 0.054;
  const Answer refused = part(2, std::move(light));
  EXPECT_EQ(refused.code(), Code::kInvalidValue);
  EXPECT_THAT(refused.reply.status.node_ids, ElementsAre(rest[2]));
  const Answer two = part(2, closed(1, rest));
  ASSERT_TRUE(two.reply.status.ok()) << two.reply.status.text;
  const auto stress = undivided.reply.batch.f64(Field::kShearStress);
  EXPECT_TRUE(std::ranges::equal(one.reply.batch.f64(Field::kShearStress), stress.first(kFirst)));
  EXPECT_TRUE(std::ranges::equal(two.reply.batch.f64(Field::kShearStress), stress.subspan(kFirst)));
}

// Nodes with layers of their own thickness: each half zone must be heavier than the layer of its node.
TEST(ServiceInertia, EachHalfZoneIsHeldToTheLayerOfItsNode) {
  ServiceHarness harness;
  wire::Request opening = ServiceHarness::opening(waves(), {});
  std::get<wire::OpenSession>(opening.body).domain = "of one's own";
  std::get<wire::OpenSession>(opening.body).parameters = {"layer.thickness_m"};
  opening.batch = {};
  const Answer opened = harness.ask(opening);
  ASSERT_TRUE(opened.reply.status.ok()) << opened.reply.status.text;
  constexpr Field kColumns[] = {Field::kNodeId, Field::kParameter};
  wire::Request nodes = ServiceHarness::in_session(wire::RegisterNodes{}, 1);
  nodes.batch = wire::Batch::of(kColumns, kNodes.size());
  std::ranges::copy(kNodes, nodes.batch.u64(Field::kNodeId).begin());
  for (std::size_t i = 0; i < kNodes.size(); ++i)
    nodes.batch.f64(Field::kParameter)[i] = 10e-6 + 2e-6 * static_cast<double>(i);
  const Answer registered = harness.ask(nodes);
  ASSERT_TRUE(registered.reply.status.ok()) << registered.reply.status.text;
  wire::Batch light = closed(1);
  std::ranges::fill(light.f64(Field::kMassSoft), 0.06);  // of 22.2 um of aluminium
  const Answer refused = harness.ask(ServiceHarness::step(2, std::move(light)));
  EXPECT_EQ(refused.code(), Code::kInvalidValue);
  EXPECT_THAT(refused.reply.status.node_ids, ElementsAre(kNodes[7], kNodes[8], kNodes[9], kNodes[10]));
  EXPECT_THAT(refused.reply.status.text, HasSubstr("(4 of 11 rows at fault)"));
  EXPECT_TRUE(harness.ask(ServiceHarness::step(2, closed(1))).reply.status.ok());
}

TEST(ServiceInertia, TheStickFormTellsNoMassOfTheSoftBody) {
  ServiceHarness harness;
  harness.granted(ServiceHarness::opening(waves(), kNodes));
  constexpr Field kStick[] = {Field::kVelocityJump, Field::kPressure, Field::kStickStress, Field::kImpedance};
  wire::Batch batch = wire::Batch::of(kStick, kNodes.size());
  std::ranges::fill(batch.f64(Field::kImpedance), 1e7);
  const Answer refused = harness.ask(ServiceHarness::step(1, std::move(batch)));
  EXPECT_EQ(refused.code(), Code::kUnsupported);
  EXPECT_THAT(refused.reply.status.text, HasSubstr("with layer.inertia the mass of the layer is taken"));
  EXPECT_THAT(refused.reply.status.remedy, HasSubstr("far-field form"));
}

TEST(ServiceInertia, WhatNeedsOneStressIsRefused) {
  ServiceHarness harness;
  harness.granted(ServiceHarness::opening(waves(), kNodes));
  wire::Request step = ServiceHarness::step(1, closed(1));
  for (const Field field : {Field::kStressPerJump, Field::kInterfaceWork}) {
    std::get<wire::Downscale>(step.body).wanted = {field};
    EXPECT_EQ(harness.ask(step).code(), Code::kUnsupported) << wire::name(field);
  }
  std::get<wire::Downscale>(step.body).wanted = {Field::kShearStress, Field::kMeanShearStress};
  const Answer answer = harness.granted(step);
  EXPECT_TRUE(
      std::ranges::equal(answer.reply.batch.f64(Field::kShearStress), answer.reply.batch.f64(Field::kMeanShearStress)));
}

}  // namespace
}  // namespace shearbus::service
