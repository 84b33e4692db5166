// Force-driven layers with inertia, as a service takes their steps: whose mass is not taken from the host's is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

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

wire::Batch closed(int step) {
  wire::Batch batch = support::step_columns(Strategy::kForceDriven, kNodes, step);
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
