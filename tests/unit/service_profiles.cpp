// Tests the request read_profiles: what the rows hold, against the replies of steps, and what is refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "server/physics/material/strength.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

constexpr std::size_t kNodes = 11;  // two tiles, the last one partly filled
constexpr double kPressure = 11.2e9;

wire::Batch asking(std::span<const std::uint64_t> ids, std::optional<double> pressure = {}) {
  std::vector<Field> fields = {Field::kNodeId};
  if (pressure) fields.push_back(Field::kPressure);
  wire::Batch batch = wire::Batch::of(fields, ids.size());
  std::ranges::copy(ids, batch.u64(Field::kNodeId).begin());
  if (pressure) std::ranges::fill(batch.f64(Field::kPressure), *pressure);
  return batch;
}

struct Host {
  Host(const v1::Scene& scene, wire::Strategy used)
      : strategy(used), ids(support::node_ids(kNodes)), heat(kNodes, 0.0) {
    EXPECT_EQ(harness.ask(ServiceHarness::opening(scene, ids)).code(), Code::kOk);
  }
  Answer step(Mode mode = Mode::kAdvance) {
    ++sequence;
    wire::Batch batch = support::step_columns(strategy, ids, 0);
    std::ranges::fill(batch.f64(Field::kPressure), kPressure);
    Answer answer = harness.granted(ServiceHarness::step(sequence, std::move(batch), mode));
    const auto entered = std::as_const(answer.reply.batch).f64(Field::kFrictionHeat);
    for (std::size_t node = 0; mode == Mode::kAdvance && node < kNodes; ++node) heat[node] += entered[node];
    return answer;
  }
  Answer read(wire::Batch batch, const Caller& caller = {}) {
    wire::Request request = ServiceHarness::in_session(wire::ReadProfiles{}, 0);
    request.batch = std::move(batch);
    return harness.ask(request, caller);
  }

  ServiceHarness harness;
  wire::Strategy strategy;
  std::vector<std::uint64_t> ids;
  std::vector<double> heat;  // that has entered each node  [J/m2]
  std::uint64_t sequence = 0;
};

// The rows of one node.
struct Rows {
  Rows(const Answer& answer, std::size_t node)
      : body(std::get<wire::Profiles>(answer.reply.body)), batch(answer.reply.batch), first(node * body.vertices) {}
  std::span<const double> operator()(Field field) const {
    const auto all = batch.f64(field);
    return all.empty() ? all : all.subspan(first, body.vertices);
  }
  const wire::Profiles& body;
  const wire::Batch& batch;
  std::size_t first;
};

// Heat of one body above the temperature at the start  [J/m2].
double stored_heat(const Rows& rows, const physics::Material& metal) {
  double sum = 0.0;
  for (std::size_t i = 0; i < rows.body.vertices; ++i)
    sum += rows(Field::kWidth)[i] * (rows(Field::kLayerTemperature)[i] - 300.0);
  return metal.conductivity / metal.diffusivity * sum;
}

TEST(ServiceProfiles, HoldTheStateThatTheLastStepAnswered) {
  const v1::Scene scene = support::velocity_scene();
  Host host(scene, wire::Strategy::kVelocityDriven);
  for (int n = 0; n < 40; ++n) host.step();
  const Answer last = host.step();
  const std::vector<std::uint64_t> some = {host.ids[9], host.ids[0], host.ids[4]};
  const Answer answer = host.read(asking(some, kPressure));
  ASSERT_EQ(answer.code(), Code::kOk) << answer.reply.status.text;
  const physics::Material soft = physics::make_material(scene.soft().material(), {}).material;
  const std::size_t of[] = {9, 0, 4};
  for (std::size_t node = 0; node < some.size(); ++node) {
    const Rows rows(answer, node);
    EXPECT_EQ(rows.body.nodes, some.size());
    EXPECT_EQ(rows.body.state_version, 41U);
    EXPECT_EQ(answer.reply.batch.u64(Field::kNodeId)[rows.first], some[node]);
    EXPECT_EQ(rows(Field::kPosition)[0], 0.0);
    EXPECT_TRUE(std::ranges::is_sorted(rows(Field::kPosition)));
    EXPECT_EQ(rows(Field::kLayerTemperature)[0], last.reply.batch.f64(Field::kInterfaceTemperature)[of[node]]);
    EXPECT_NEAR(stored_heat(rows, soft) / host.heat[of[node]], 1.0, 1e-9);
    const double s = last.reply.batch.f64(Field::kShearStress)[of[node]];
    EXPECT_GT(rows(Field::kLayerPlasticStrain)[0], 0.0);
    for (std::size_t i = 0; i < rows.body.vertices; ++i) {
      const double T = rows(Field::kLayerTemperature)[i], ep = rows(Field::kLayerPlasticStrain)[i];
      const double Y = rows(Field::kLayerFlowStress)[i];
      EXPECT_EQ(rows(Field::kLayerShearStress)[i], s);
      EXPECT_EQ(Y, physics::flow_stress(soft, ep, kPressure, T));
      EXPECT_LE(physics::kSqrt3 * std::abs(s), Y * (1.0 + 1e-9)) << i;  // no vertex is loaded beyond its flow stress
    }
  }
}

TEST(ServiceProfiles, LeaveTheSessionAsItIs) {
  Host read(support::velocity_scene(), wire::Strategy::kVelocityDriven);
  Host plain(support::velocity_scene(), wire::Strategy::kVelocityDriven);
  for (int n = 0; n < 20; ++n) {
    const auto before = read.read(asking(read.ids)).payload();
    EXPECT_EQ(read.step(Mode::kTrial).payload(), plain.step(Mode::kTrial).payload());
    EXPECT_EQ(read.read(asking(read.ids)).payload(), before) << "a trial is not looked at";
    EXPECT_EQ(read.step().payload(), plain.step().payload());
    EXPECT_NE(read.read(asking(read.ids)).payload(), before);
  }
}

TEST(ServiceProfiles, HaveBothBodiesWhereBothConduct) {
  v1::Scene scene = support::force_scene();
  scene.mutable_hard_layer()->set_cells(30);
  scene.mutable_hard_layer()->set_thickness_m(15e-6);
  scene.mutable_hard_layer()->set_grading(1.1);
  Host host(scene, wire::Strategy::kForceDriven);
  for (int n = 0; n < 30; ++n) host.step();
  const Answer answer = host.read(asking(host.ids));
  ASSERT_EQ(answer.code(), Code::kOk) << answer.reply.status.text;
  EXPECT_FALSE(answer.reply.batch.has(Field::kLayerPlasticStrain));  // this layer cannot flow
  const Rows rows(answer, 3);
  const auto z = rows(Field::kPosition);
  EXPECT_TRUE(std::ranges::is_sorted(z));
  EXPECT_NEAR(z.front(), -15e-6, 1e-18);
  EXPECT_EQ(std::ranges::count(z, 0.0), 1);
  const auto interface = static_cast<std::size_t>(std::ranges::find(z, 0.0) - z.begin());
  EXPECT_EQ(interface, 30U);
  const auto T = rows(Field::kLayerTemperature);
  EXPECT_EQ(std::ranges::max(T), T[interface]);
  EXPECT_GT(T[interface - 1], 300.0);
  for (std::size_t i = 0; i < z.size(); ++i)
    EXPECT_EQ(std::isnan(rows(Field::kLayerShearStress)[i]), i < interface) << i;
}

TEST(ServiceProfiles, OfAHalfSpaceReachBehindTheLayer) {
  v1::Scene scene = support::velocity_scene();
  scene.mutable_layer()->set_far_boundary(v1::FAR_BOUNDARY_HALF_SPACE);
  Host host(scene, wire::Strategy::kVelocityDriven);
  for (int n = 0; n < 20; ++n) host.step();
  const Answer answer = host.read(asking(host.ids));
  const Rows rows(answer, 0);
  const double h = scene.layer().thickness_m();
  double width_of_layer = 0.0;
  for (std::size_t i = 0; i < rows.body.vertices; ++i) {
    const bool outside = rows(Field::kPosition)[i] > h * (1.0 + 1e-12);
    EXPECT_EQ(std::isnan(rows(Field::kLayerPlasticStrain)[i]), outside) << i;
    if (!outside) width_of_layer += rows(Field::kWidth)[i];
  }
  EXPECT_NEAR(width_of_layer / h, 1.0, 0.2);  // the last vertex also stands for a part behind the layer
  EXPECT_GT(rows(Field::kPosition).back(), 900.0 * h);
}

// With inertia the stress is a field: at z = 0 it is that of the reply.
TEST(ServiceProfiles, OfALayerWithInertiaHaveAStressOfEachVertex) {
  v1::Scene scene = support::velocity_scene();
  scene.mutable_layer()->set_inertia(true);
  Host host(scene, wire::Strategy::kVelocityDriven);
  const Answer last = host.step();
  const Answer answer = host.read(asking(host.ids));
  const Rows rows(answer, 0);
  const auto s = rows(Field::kLayerShearStress);
  EXPECT_EQ(s[0], last.reply.batch.f64(Field::kShearStress)[0]);
  EXPECT_NE(s[s.size() / 2], s[0]);
}

TEST(ServiceProfiles, OfASleepingNodeAreItsTemperatures) {
  v1::Scene scene = support::force_scene();
  scene.mutable_layer()->set_sleep(true);
  Host host(scene, wire::Strategy::kForceDriven);
  for (int n = 0; n < 5; ++n) host.step();
  const auto open_step = [&] {
    wire::Batch batch = support::step_columns(host.strategy, host.ids, 0);
    std::ranges::fill(batch.f64(Field::kPressure), -1.0);
    return host.harness.ask(ServiceHarness::step(++host.sequence, std::move(batch)));
  };
  for (int n = 0; n < 80; ++n) open_step();
  const Answer last = open_step();
  const auto node = static_cast<std::size_t>(std::ranges::max_element(host.heat) - host.heat.begin());
  ASSERT_EQ(last.reply.batch.u8(Field::kOutcome)[node], wire::kAsleep);
  const Answer answer = host.read(asking(host.ids));
  const Rows rows(answer, node);
  const double T0 = last.reply.batch.f64(Field::kInterfaceTemperature)[node];
  EXPECT_NEAR(rows(Field::kLayerTemperature)[0] / T0, 1.0, 1e-12);
  const physics::Material soft = physics::make_material(scene.soft().material(), {}).material;
  EXPECT_NEAR(stored_heat(rows, soft) / host.heat[node], 1.0, 1e-8);
}

TEST(ServiceProfiles, AreRefusedWithTheirReason) {
  Host host(support::velocity_scene(), wire::Strategy::kVelocityDriven);
  const auto fault = [&](wire::Batch batch, const Caller& caller = {}) {
    return host.read(std::move(batch), caller).reply.status;
  };
  EXPECT_EQ(fault(asking(std::vector<std::uint64_t>{host.ids[0], 424242})).code, Code::kUnknownNode);
  EXPECT_EQ(fault(asking(std::vector<std::uint64_t>{host.ids[0], host.ids[0]})).code, Code::kDuplicateNode);
  EXPECT_EQ(fault(asking(std::vector<std::uint64_t>{})).code, Code::kShape);
  EXPECT_EQ(fault({}).code, Code::kShape);
  EXPECT_EQ(fault(asking(host.ids, std::numeric_limits<double>::quiet_NaN())).code, Code::kInvalidValue);
  const wire::Status shape = fault(support::step_columns(host.strategy, host.ids, 0, true));
  EXPECT_EQ(shape.code, Code::kShape);
  EXPECT_NE(shape.text.find("velocity_jump_m_per_s does not belong"), std::string::npos) << shape.text;
  EXPECT_EQ(fault(asking(host.ids), {.identity = "uid 7"}).code, Code::kNotPermitted);
  EXPECT_EQ(fault(asking(host.ids), {.identity = "uid 7", .is_operator = true}).code, Code::kOk);
  wire::Request elsewhere = ServiceHarness::in_session(wire::ReadProfiles{}, 0, 9);
  elsewhere.batch = asking(host.ids);
  EXPECT_EQ(host.harness.ask(elsewhere).code(), Code::kUnknownSession);
  wire::Request late = ServiceHarness::in_session(wire::ReadProfiles{}, 0);
  late.epoch = 5;
  late.batch = asking(host.ids);
  EXPECT_EQ(host.harness.ask(late).code(), Code::kEpoch);

  const wire::Status none =
      Host(support::modes_scene(), wire::Strategy::kForceDriven).read(asking(host.ids)).reply.status;
  EXPECT_EQ(none.code, Code::kUnsupported);
  EXPECT_EQ(none.field, "layer.heat");
}

TEST(ServiceProfiles, OfMoreRowsThanAMessageHoldsAreRefused) {
  ServiceHarness harness;
  const auto ids = support::node_ids(9000);
  harness.granted(ServiceHarness::opening(support::velocity_scene(), ids));
  wire::Request request = ServiceHarness::in_session(wire::ReadProfiles{}, 0);
  request.batch = asking(ids);
  const wire::Status fault = harness.ask(request).reply.status;
  EXPECT_EQ(fault.code, Code::kLimit);
  EXPECT_NE(fault.remedy.find("at most"), std::string::npos);
}

}  // namespace
}  // namespace shearbus::service
