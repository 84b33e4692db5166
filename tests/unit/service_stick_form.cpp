// Requests in stick form: the columns that they need, and their answers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

using testing::HasSubstr;

const std::vector<std::uint64_t> kNodes = support::node_ids(19);
constexpr double kDt = 1e-9;
constexpr Field kStick[] = {Field::kVelocityJump, Field::kPressure, Field::kStickStress, Field::kImpedance};

TEST(StickForm, DtIsTheTimeOfTheLayerOnly) {
  // Two sessions send the same momentum balance with steps of dt and 2 dt. The interface slips at the Coulomb limit
  // mu P in both, so the jump changes by the same amount, and the heat is proportional to the step length.
  ServiceHarness harness;
  std::vector<double> jump_new, heat;
  for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}}) {
    harness.granted(ServiceHarness::opening(support::force_scene(), kNodes, session));
    wire::Batch batch = wire::Batch::of(kStick, kNodes.size());
    std::ranges::fill(batch.f64(Field::kVelocityJump), 10.0);
    std::ranges::fill(batch.f64(Field::kPressure), 1e8);
    std::ranges::fill(batch.f64(Field::kImpedance), 5e7);
    std::ranges::fill(batch.f64(Field::kStickStress), 5e7 * 10.0);
    wire::Request request = ServiceHarness::step(1, std::move(batch), wire::Mode::kAdvance, session);
    std::get<wire::Downscale>(request.body).dt_s = session * kDt;
    const Answer answer = harness.granted(request);
    jump_new.push_back(std::as_const(answer.reply.batch).f64(Field::kVelocityJumpNew)[0]);
    heat.push_back(std::as_const(answer.reply.batch).f64(Field::kFrictionHeat)[0]);
  }
  EXPECT_NEAR(jump_new[0], 10.0 - 0.3 * 1e8 / 5e7, 1e-9) << "Coulomb: s = 0.3 P";
  EXPECT_NEAR(jump_new[1], jump_new[0], 1e-12);
  EXPECT_NEAR(heat[1], 2.0 * heat[0], 1e-9 * heat[0]);
}

struct Fault {
  std::vector<Field> columns;
  const char* field;
  const char* text;
};

TEST(StickForm, ARequestHasOneForm) {
  ServiceHarness harness, twin;
  for (ServiceHarness* h : {&harness, &twin}) h->granted(ServiceHarness::opening(support::force_scene(), kNodes));
  const Fault faults[] = {
      {{Field::kVelocityJump, Field::kPressure, Field::kStickStress, Field::kImpedance, Field::kStressSoft},
       "stress_soft_pa",
       "columns stick_stress_pa and stress_soft_pa are of different forms"},
      {{Field::kVelocityJump, Field::kPressure, Field::kStressSoft, Field::kStressHard, Field::kMassSoft,
        Field::kMassHard, Field::kImpedance},
       "stress_soft_pa",
       "columns impedance_pa_s_per_m and stress_soft_pa are of different forms"},
      {{Field::kVelocityJump, Field::kPressure, Field::kStickStress},
       "impedance_pa_s_per_m",
       "column impedance_pa_s_per_m is missing"},
      {{Field::kVelocityJump, Field::kPressure, Field::kImpedance}, "stick_stress_pa", "stick_stress_pa is missing"},
      {{Field::kVelocityJump, Field::kStickStress, Field::kImpedance}, "pressure_pa", "column pressure_pa is missing"},
      {{Field::kVelocityJump, Field::kPressure}, "stress_soft_pa", "column stress_soft_pa is missing"},
  };
  for (const Fault& fault : faults) {
    const Answer refused = harness.ask(ServiceHarness::step(1, wire::Batch::of(fault.columns, kNodes.size())));
    EXPECT_EQ(refused.code(), Code::kShape);
    EXPECT_EQ(refused.reply.status.field, fault.field);
    EXPECT_THAT(refused.reply.status.text, HasSubstr(fault.text));
    EXPECT_THAT(refused.reply.status.remedy, HasSubstr("mass_hard_kg_per_m2 (far-field form), or"));
    EXPECT_THAT(refused.reply.status.remedy, HasSubstr("stick_stress_pa, impedance_pa_s_per_m (stick form)"));
  }
  const auto step = [] { return ServiceHarness::step(1, support::step_columns(Strategy::kForceDriven, kNodes, 1)); };
  EXPECT_EQ(harness.ask(step()).payload(), twin.ask(step()).payload()) << "refusals changed nothing";
}

TEST(StickForm, HasBoundsAndBelongsToForceDrivenScenes) {
  ServiceHarness harness;
  harness.granted(ServiceHarness::opening(support::force_scene(), kNodes, 1));
  harness.granted(ServiceHarness::opening(support::velocity_scene(), kNodes, 2));
  for (const double bad : {0.0, -1e7, 1e300, std::nan("")}) {
    wire::Batch batch = wire::Batch::of(kStick, kNodes.size());
    std::ranges::fill(batch.f64(Field::kImpedance), 1e7);
    batch.f64(Field::kImpedance)[3] = bad;
    const Answer refused = harness.ask(ServiceHarness::step(1, std::move(batch)));
    EXPECT_EQ(refused.code(), Code::kInvalidValue);
    EXPECT_EQ(refused.reply.status.field, "impedance_pa_s_per_m");
    EXPECT_THAT(refused.reply.status.node_ids, testing::ElementsAre(kNodes[3]));
  }
  const Answer refused =
      harness.ask(ServiceHarness::step(1, wire::Batch::of(kStick, kNodes.size()), wire::Mode::kAdvance, 2));
  EXPECT_EQ(refused.code(), Code::kShape);
  EXPECT_THAT(refused.reply.status.text, HasSubstr("stick_stress_pa does not belong to a step of this scene"));
}

}  // namespace
}  // namespace shearbus::service
