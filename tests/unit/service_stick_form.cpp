// Requests in stick form: the columns that they need, and their answers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

using testing::HasSubstr;

const std::vector<std::uint64_t> kNodes = support::node_ids(19);
constexpr double kDt = 1e-9;
constexpr Field kStick[] = {Field::kVelocityJump, Field::kPressure, Field::kStickStress, Field::kImpedance};

v1::Scene scene_of(std::uint32_t components, bool plastic_layer) {
  v1::Scene scene = support::force_scene();
  scene.set_tangential_components(components);
  scene.mutable_interface()->set_plastic_layer(plastic_layer);
  return scene;
}

// Returns a request in far-field form. The second component of each vector is -0.3 times the first. If `last_answer` is
// not null, the velocity jumps are the new jumps of that answer.
wire::Batch far_field(std::uint32_t components, int step, const wire::Batch* last_answer) {
  const wire::Batch scalar = support::step_columns(Strategy::kForceDriven, kNodes, step);
  wire::Batch batch = wire::Batch::of(wire::columns_of(Strategy::kForceDriven).required, kNodes.size(), components);
  for (const wire::Column& column : batch.columns())
    for (std::size_t row = 0; row < kNodes.size(); ++row)
      batch.f64(column.field, column.component)[row] =
          (column.component == 0 ? 1.0 : -0.3) * scalar.f64(column.field)[row];
  for (std::uint32_t component = 0; last_answer != nullptr && component < components; ++component)
    std::ranges::copy(last_answer->f64(Field::kVelocityJumpNew, component),
                      batch.f64(Field::kVelocityJump, component).begin());
  return batch;
}

wire::Batch in_stick_form(const wire::Batch& far_field, std::uint32_t components) {
  wire::Batch batch = wire::Batch::of(kStick, kNodes.size(), components);
  for (std::size_t row = 0; row < kNodes.size(); ++row) {
    const double soft = far_field.f64(Field::kMassSoft)[row], hard = far_field.f64(Field::kMassHard)[row];
    const double impedance = 1.0 / (kDt * (1.0 / soft + 1.0 / hard));
    batch.f64(Field::kPressure)[row] = far_field.f64(Field::kPressure)[row];
    batch.f64(Field::kImpedance)[row] = impedance;
    for (std::uint32_t component = 0; component < components; ++component) {
      const double jump = far_field.f64(Field::kVelocityJump, component)[row];
      const double free_jump = jump + kDt * (far_field.f64(Field::kStressSoft, component)[row] / soft +
                                             far_field.f64(Field::kStressHard, component)[row] / hard);
      batch.f64(Field::kVelocityJump, component)[row] = jump;
      batch.f64(Field::kStickStress, component)[row] = impedance * free_jump;
    }
  }
  return batch;
}

TEST(StickForm, HasTheAnswersOfTheFarFieldForm) {
  for (const std::uint32_t components : {1U, 2U})
    for (const bool plastic_layer : {false, true}) {
      SCOPED_TRACE(std::to_string(components) + (plastic_layer ? " components, plastic layer" : " components"));
      ServiceHarness harness;
      for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}}) {
        const auto opening = ServiceHarness::opening(scene_of(components, plastic_layer), kNodes, session);
        ASSERT_TRUE(harness.ask(opening).reply.status.ok());
      }
      Answer far, stick;
      for (int step = 1; step <= 25; ++step) {
        const wire::Batch* last = step > 1 ? &far.reply.batch : nullptr;
        wire::Batch request = far_field(components, step, last);
        wire::Batch stick_request = in_stick_form(request, components);
        const auto sequence = static_cast<std::uint64_t>(step);
        far = harness.ask(ServiceHarness::step(sequence, std::move(request)));
        stick = harness.ask(ServiceHarness::step(sequence, std::move(stick_request), wire::Mode::kAdvance, 2));
        ASSERT_TRUE(far.reply.status.ok()) << describe(far.reply.status);
        ASSERT_TRUE(stick.reply.status.ok()) << describe(stick.reply.status);
        for (const wire::Column& column : far.reply.batch.columns()) {
          if (column.element != wire::Element::kFloat64) continue;
          const double size = column.field == Field::kShearStress ? 1e9 : 100.0;
          for (std::size_t row = 0; row < kNodes.size(); ++row)
            ASSERT_NEAR(std::as_const(stick.reply.batch).f64(column.field, column.component)[row],
                        std::as_const(far.reply.batch).f64(column.field, column.component)[row], 1e-9 * size)
                << wire::name(column.field) << ", step " << step << ", row " << row;
        }
      }
    }
}

TEST(StickForm, DtIsTheTimeOfTheLayerOnly) {
  // Two sessions send the same momentum balance with steps of dt and 2 dt. The interface slips at the Coulomb limit
  // mu P in both, so the jump changes by the same amount, and the heat is proportional to the step length.
  ServiceHarness harness;
  std::vector<double> jump_new, heat;
  for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}}) {
    ASSERT_TRUE(harness.ask(ServiceHarness::opening(support::force_scene(), kNodes, session)).reply.status.ok());
    wire::Batch batch = wire::Batch::of(kStick, kNodes.size());
    std::ranges::fill(batch.f64(Field::kVelocityJump), 10.0);
    std::ranges::fill(batch.f64(Field::kPressure), 1e8);
    std::ranges::fill(batch.f64(Field::kImpedance), 5e7);
    std::ranges::fill(batch.f64(Field::kStickStress), 5e7 * 10.0);
    wire::Request request = ServiceHarness::step(1, std::move(batch), wire::Mode::kAdvance, session);
    std::get<wire::Downscale>(request.body).dt_s = session * kDt;
    const Answer answer = harness.ask(request);
    ASSERT_TRUE(answer.reply.status.ok()) << describe(answer.reply.status);
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
  for (ServiceHarness* h : {&harness, &twin})
    ASSERT_TRUE(h->ask(ServiceHarness::opening(support::force_scene(), kNodes)).reply.status.ok());
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
  ASSERT_TRUE(harness.ask(ServiceHarness::opening(support::force_scene(), kNodes, 1)).reply.status.ok());
  ASSERT_TRUE(harness.ask(ServiceHarness::opening(support::velocity_scene(), kNodes, 2)).reply.status.ok());
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
