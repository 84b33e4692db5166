// Tests of slip with two tangential components, from the client through the wire to the server and back.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus {
namespace {

using support::RunningServer;
using wire::Strategy;

constexpr std::size_t kNodes = 300;
constexpr int kSteps = 20;

v1::Scene plane_scene(Strategy strategy) {
  v1::Scene scene = support::scene_of(strategy);
  scene.set_tangential_components(2);
  return scene;
}

constexpr Field kTangential[] = {Field::kVelocityJump, Field::kStressSoft, Field::kStressHard};

// Fills the columns of `request` with those of the scalar step `scalar`. Each vector of the request has the scalar's
// value in the direction `angle` in the plane of the interface.
void fill_along(double angle, const Batch& scalar, Batch& request) {
  for (const wire::Column& column : scalar.columns()) {
    const auto values = scalar.f64(column.field);
    if (std::find(std::begin(kTangential), std::end(kTangential), column.field) == std::end(kTangential)) {
      std::ranges::copy(values, request.f64(column.field).begin());
      continue;
    }
    for (std::size_t i = 0; i < values.size(); ++i) {
      request.f64(column.field)[i] = std::cos(angle) * values[i];
      request.f64(column.field, 1)[i] = std::sin(angle) * values[i];
    }
  }
}

class TwoComponents : public testing::TestWithParam<Strategy> {};
INSTANTIATE_TEST_SUITE_P(Strategies, TwoComponents, support::both<Strategy>(), support::name_of_strategy);

TEST_P(TwoComponents, AScalarProblemTurnedInThePlaneHasItsAnswerTurned) {
  RunningServer server;
  Client client = server.client("ipc");
  const auto ids = support::node_ids(kNodes);
  Session line = client.open(support::text_of(support::scene_of(GetParam())), "scene", ids);
  Session plane = client.open(support::text_of(plane_scene(GetParam())), "scene", ids);
  EXPECT_EQ(plane.opened.tangential_components, 2U);
  // With two components a node has a second stress component, in its committed and in its trial state.
  EXPECT_EQ(plane.opened.bytes_per_node, line.opened.bytes_per_node + 2 * sizeof(double));
  const double angle = 0.7;
  for (int step = 0; step < kSteps; ++step) {
    const Batch scalar = support::step_columns(GetParam(), ids, step);
    Batch request = plane.request();
    fill_along(angle, scalar, request);
    const StepResult& want = line.advance(scalar, {.dt_s = 1e-9});
    const StepResult& found = plane.advance(request, {.dt_s = 1e-9});
    for (std::size_t i = 0; i < kNodes; ++i) {
      const double s = want.shear_stress_pa()[i];
      ASSERT_NEAR(found.shear_stress_pa()[i], std::cos(angle) * s, 1e-7 * std::abs(s) + 1e-6) << step;
      ASSERT_NEAR(found.shear_stress_pa(1)[i], std::sin(angle) * s, 1e-7 * std::abs(s) + 1e-6) << step;
      const double v = want.sliding_velocity_m_per_s()[i];
      ASSERT_NEAR(found.sliding_velocity_m_per_s()[i], std::cos(angle) * v, 1e-6 * std::abs(v) + 1e-6) << step;
      ASSERT_NEAR(found.sliding_velocity_m_per_s(1)[i], std::sin(angle) * v, 1e-6 * std::abs(v) + 1e-6) << step;
      ASSERT_NEAR(found.interface_temperature_k()[i], want.interface_temperature_k()[i], 1e-8);
      ASSERT_EQ(found.velocity_jump_new_m_per_s(1).empty(), GetParam() == Strategy::kVelocityDriven);
    }
  }
}

TEST_P(TwoComponents, BothComponentsAreAskedForAndNoOthers) {
  RunningServer server;
  Client client = server.client("ipc");
  const auto ids = support::node_ids(3);
  const auto refused = [&](Session& session, const Batch& request) {
    try {
      session.advance(request, {.dt_s = 1e-9});
    } catch (const Error& error) {
      return error.status();
    }
    return Status{};
  };
  Session line = client.open(support::text_of(support::scene_of(GetParam())), "scene", ids);
  Session plane = client.open(support::text_of(plane_scene(GetParam())), "scene", ids);
  const Batch one = support::step_columns(GetParam(), ids, 0);
  Batch two = plane.request();
  fill_along(0.3, one, two);
  EXPECT_EQ(refused(line, two).code, Code::kUnsupported);
  EXPECT_THAT(refused(plane, one).text, testing::HasSubstr("component 1 of column velocity_jump_m_per_s is missing"));
  two.f64(Field::kVelocityJump, 1)[1] = std::nan("");
  EXPECT_EQ(refused(plane, two).code, Code::kInvalidValue);
  auto columns = two.columns();
  for (wire::Column& column : columns)
    if (column.field == Field::kPressure) column.component = 1;
  EXPECT_NE(refused(plane, Batch::over(columns, two.bytes())).text, "");
  fill_along(0.3, one, two);
  EXPECT_EQ(refused(plane, two).text, "");
}

}  // namespace
}  // namespace shearbus
