// The closure check of the service. The closure is the velocity jump in a request less the jump in the answer before it
// (column closure_m_per_s). Trial steps, rollbacks to a mark and moves of nodes between sessions must not disturb it. A
// session that checks closure also warns of a host time that does not grow by dt_s.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "server/shard/closure.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

const std::vector<std::uint64_t> kNodes = support::node_ids(11);
constexpr double kDt = 1e-9;

wire::Request opening(const v1::Scene& scene, bool check_closure, std::uint8_t session = 1,
                      std::span<const std::uint64_t> nodes = kNodes, const std::string& domain = {}) {
  wire::Request request = ServiceHarness::opening(scene, nodes, session);
  auto& open = std::get<wire::OpenSession>(request.body);
  open.check_closure = check_closure;
  open.domain = domain;
  return request;
}

// A host that applies the answers: the jumps of its next request are those of the last answer. Tests add errors to
// `jump`.
struct Host {
  std::span<const std::uint64_t> nodes = kNodes;
  std::uint32_t components = 1;
  std::vector<double> jump[2];

  wire::Batch request(int step, bool with_ids = false) {
    const wire::Batch scalar = support::step_columns(Strategy::kForceDriven, nodes, step);
    std::vector<Field> fields(wire::columns_of(Strategy::kForceDriven).required.begin(),
                              wire::columns_of(Strategy::kForceDriven).required.end());
    if (with_ids) fields.push_back(Field::kNodeId);
    wire::Batch batch = wire::Batch::of(fields, nodes.size(), components);
    for (const Field field : wire::columns_of(Strategy::kForceDriven).required)
      for (std::uint32_t c = 0; c < (wire::is_tangential(field) ? components : 1); ++c)
        for (std::size_t row = 0; row < nodes.size(); ++row)
          batch.f64(field, c)[row] = (c == 0 ? 1.0 : 0.4) * scalar.f64(field)[row];
    for (std::uint32_t c = 0; c < components && !jump[c].empty(); ++c)
      std::ranges::copy(jump[c], batch.f64(Field::kVelocityJump, c).begin());
    if (with_ids) std::ranges::copy(nodes, batch.u64(Field::kNodeId).begin());
    return batch;
  }
  void apply(const Answer& answer) {
    for (std::uint32_t c = 0; c < components; ++c) {
      const auto answered = std::as_const(answer.reply.batch).f64(Field::kVelocityJumpNew, c);
      jump[c].assign(answered.begin(), answered.end());
    }
  }
};

wire::Request step_of(std::uint64_t sequence, wire::Batch batch, double time = 0.0,
                      wire::Mode mode = wire::Mode::kAdvance, std::uint8_t session = 1) {
  wire::Request request = ServiceHarness::step(sequence, std::move(batch), mode, session);
  auto& step = std::get<wire::Downscale>(request.body);
  step.time_s = time;
  step.wanted = {Field::kShearStress, Field::kVelocityJumpNew, Field::kOutcome, Field::kClosure};
  return request;
}

const wire::Upscale& upscale(const Answer& answer) {
  return std::get<wire::Upscale>(answer.reply.body);
}

std::vector<double> closure_of(const Answer& answer, std::uint32_t component = 0) {
  const auto column = std::as_const(answer.reply.batch).f64(Field::kClosure, component);
  return {column.begin(), column.end()};
}

v1::Scene scene_of(std::uint32_t components) {
  v1::Scene scene = support::force_scene();
  scene.set_tangential_components(components);
  return scene;
}

TEST(Closure, IsTheJumpOfTheRequestLessTheJumpAnsweredBefore) {
  for (const std::uint32_t components : {1U, 2U})
    for (const unsigned threads : {1U, 4U}) {
      ServiceHarness harness(threads, {.nodes_per_task = 2});
      harness.granted(opening(scene_of(components), true));
      Host host{.components = components};
      Answer answer = harness.granted(step_of(1, host.request(1)));
      for (const double difference : closure_of(answer)) EXPECT_TRUE(std::isnan(difference));
      EXPECT_EQ(upscale(answer).largest_closure_m_per_s, 0.0);
      EXPECT_EQ(upscale(answer).closure_node, kNodes[0]);
      EXPECT_EQ(upscale(answer).layer_time_s, kDt);
      host.apply(answer);
      answer = harness.ask(step_of(2, host.request(2)));
      EXPECT_EQ(closure_of(answer), std::vector<double>(kNodes.size(), 0.0));
      host.apply(answer);
      host.jump[0][3] += 0.5;
      host.jump[components - 1][7] -= 1.25;
      answer = harness.ask(step_of(3, host.request(3)));
      EXPECT_NEAR(closure_of(answer)[3], 0.5, 1e-12);
      EXPECT_NEAR(closure_of(answer, components - 1)[7], -1.25, 1e-12);
      EXPECT_NEAR(upscale(answer).largest_closure_m_per_s, 1.25, 1e-12);
      EXPECT_EQ(upscale(answer).closure_node, kNodes[7]);
      EXPECT_DOUBLE_EQ(upscale(answer).layer_time_s, 3 * kDt);
      EXPECT_THAT(upscale(answer).warnings, IsEmpty());
    }
}

TEST(Closure, ComparesWithTheCommittedStep) {
  ServiceHarness harness;
  harness.granted(opening(scene_of(1), true));
  Host host;
  Answer first = harness.ask(step_of(1, host.request(1)));
  host.apply(first);
  harness.granted(ServiceHarness::in_session(wire::Mark{.name = "here"}, 2));
  // After a trial that was rolled back, the closure refers to the answer of the last committed step.
  harness.ask(step_of(3, host.request(5), 0.0, wire::Mode::kTrial));
  harness.ask(ServiceHarness::in_session(wire::Rollback{}, 4));
  Answer answer = harness.ask(step_of(5, host.request(2), 0.0, wire::Mode::kTrial));
  EXPECT_EQ(upscale(answer).largest_closure_m_per_s, 0.0);
  EXPECT_DOUBLE_EQ(upscale(answer).layer_time_s, 2 * kDt);
  // The closure of a step that commits the previous trial refers to the answer of this trial.
  Host later = host;
  later.apply(answer);
  wire::Request next = step_of(6, later.request(3), 0.0, wire::Mode::kTrial);
  std::get<wire::Downscale>(next.body).commit_previous = true;
  answer = harness.ask(next);
  EXPECT_EQ(upscale(answer).largest_closure_m_per_s, 0.0);
  EXPECT_DOUBLE_EQ(upscale(answer).layer_time_s, 3 * kDt);
  // A rollback to a mark restores the answered jump that the node had at the mark.
  harness.granted(ServiceHarness::in_session(wire::Rollback{.to_mark = "here"}, 7));
  answer = harness.ask(step_of(8, host.request(2)));
  EXPECT_EQ(upscale(answer).largest_closure_m_per_s, 0.0);
  EXPECT_DOUBLE_EQ(upscale(answer).layer_time_s, 2 * kDt);
}

TEST(Closure, MovesWithItsNodeAndNeedsTheSameCheckOnBothSides) {
  ServiceHarness harness;
  const std::vector<std::uint64_t> four = support::node_ids(4), none;
  harness.granted(opening(scene_of(1), true, 1, four, "run"));
  harness.granted(opening(scene_of(1), true, 2, none, "run"));
  harness.granted(opening(scene_of(1), false, 3, none, "run"));
  Host host{.nodes = four};
  host.apply(harness.ask(step_of(1, host.request(1))));
  const wire::OfferNodes offer{.transfer_id = ServiceHarness::id(9)};
  harness.granted(ServiceHarness::of_nodes(offer, std::span(four).subspan(2, 1), 2));
  const auto accept = [&](std::uint8_t session) {
    return harness.ask(ServiceHarness::in_session(wire::AcceptNodes{.transfer_id = ServiceHarness::id(9)}, 1, session));
  };
  const Answer refused = accept(3);
  EXPECT_EQ(refused.code(), Code::kOtherScene);
  EXPECT_THAT(refused.reply.status.text, HasSubstr("checks closure, and this session does not"));
  ASSERT_TRUE(accept(2).reply.status.ok());
  const std::vector<std::uint64_t> moved = {four[2]};
  Host taker{.nodes = moved, .jump = {{host.jump[0][2] + 0.25}}};
  const Answer answer = harness.ask(step_of(2, taker.request(2), 0.0, wire::Mode::kAdvance, 2));
  EXPECT_NEAR(upscale(answer).largest_closure_m_per_s, 0.25, 1e-12);
  EXPECT_DOUBLE_EQ(upscale(answer).layer_time_s, 2 * kDt);
}

TEST(Closure, OpenAbsentNodesHaveNoAnsweredJump) {
  ServiceHarness harness;
  harness.granted(opening(scene_of(1), true));
  Host host;
  host.apply(harness.ask(step_of(1, host.request(1))));
  const std::vector<std::uint64_t> first = {kNodes[0]};
  Host one{.nodes = first, .jump = {{host.jump[0][0]}}};
  wire::Request request = step_of(2, one.request(2, true));
  std::get<wire::Downscale>(request.body).absent_nodes = wire::AbsentNodes::kOpen;
  const Answer open = harness.ask(request);
  EXPECT_EQ(closure_of(open), std::vector<double>{0.0});
  const Answer answer = harness.ask(step_of(3, host.request(3)));
  for (std::size_t row = 1; row < kNodes.size(); ++row) EXPECT_TRUE(std::isnan(closure_of(answer)[row]));
  EXPECT_FALSE(std::isnan(closure_of(answer)[0]));
  EXPECT_DOUBLE_EQ(upscale(answer).layer_time_s, 3 * kDt) << "open layers go on in time";
}

TEST(Closure, CostsNothingWhereItIsNotChecked) {
  ServiceHarness harness;
  const auto bytes = [&](const v1::Scene& scene, bool check, std::uint8_t session) {
    const Answer opened = harness.ask(opening(scene, check, session));
    const auto& body = std::get<wire::SessionOpened>(opened.reply.body);
    EXPECT_EQ(std::ranges::count(body.columns_on_request, Field::kClosure),
              check && scene.strategy() == v1::STRATEGY_FORCE_DRIVEN);
    return body.bytes_per_node;
  };
  const std::uint64_t off = bytes(scene_of(1), false, 1);
  EXPECT_EQ(bytes(scene_of(1), true, 2), off + 2 * 3 * sizeof(double)) << "three states in two buffers";
  EXPECT_EQ(bytes(support::velocity_scene(), true, 3), bytes(support::velocity_scene(), false, 4));
  Host host;
  const Answer refused = harness.ask(step_of(1, host.request(1)));
  EXPECT_EQ(refused.code(), Code::kUnsupported);
  EXPECT_THAT(refused.reply.status.remedy, HasSubstr("open_session.check_closure"));
  // A session with the check and a session without give the same bits.
  for (std::uint64_t sequence = 1; sequence <= 4; ++sequence) {
    std::vector<std::vector<std::byte>> payloads;
    for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}}) {
      const Answer answer = harness.granted(ServiceHarness::step(
          sequence, support::step_columns(Strategy::kForceDriven, kNodes, static_cast<int>(sequence)),
          wire::Mode::kAdvance, session));
      payloads.push_back(answer.payload());
      EXPECT_EQ(upscale(answer).layer_time_s == 0.0, session == 1);
    }
    EXPECT_EQ(payloads[0], payloads[1]);
  }
}

TEST(Closure, ALayerThatFlowsIsTheHalfZoneOfItsNode) {
  ServiceHarness harness;
  constexpr double kDensity = 2700.0, kHalfZone = 125e-6;
  // Layers as thick as the half zone, as the whole zone, and half zones whose masses differ by a tenth.
  const struct {
    double layer, mass;
    bool warns;
  } cases[] = {{kHalfZone, 1.0, false}, {2.0 * kHalfZone, 1.0, true}, {20e-6, 1.0, true}, {kHalfZone, 1.1, false}};
  std::uint8_t session = 0;
  for (const auto& [layer, mass, warns] : cases) {
    v1::Scene scene = scene_of(1);
    scene.mutable_soft()->set_density_kg_per_m3(kDensity);
    scene.mutable_interface()->set_plastic_layer(true);
    scene.mutable_layer()->set_thickness_m(layer);
    harness.granted(opening(scene, true, ++session));
    Host host;
    for (std::uint64_t sequence = 1; sequence <= 2; ++sequence) {
      wire::Batch batch = host.request(1, sequence == 2);
      std::ranges::fill(batch.f64(Field::kMassSoft), mass * kDensity * kHalfZone);
      const Answer answer = harness.granted(step_of(sequence, std::move(batch), 0.0, wire::Mode::kAdvance, session));
      ASSERT_EQ(upscale(answer).warnings.size(), warns ? 1U : 0U) << layer;
      if (!warns) continue;
      EXPECT_THAT(upscale(answer).warnings[0], StartsWith("layer.thickness_m: the plastic layer of node 100 is "));
      EXPECT_THAT(upscale(answer).warnings[0], HasSubstr("0.000125 m (mass_soft_kg_per_m2 over the density)"));
    }
  }
}

TEST(Closure, TheHostsTimeMustGrowByTheStep) {
  ServiceHarness harness;
  for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}, std::uint8_t{3}, std::uint8_t{4}})
    harness.granted(opening(scene_of(1), true, session));
  // Session 1 sends correct times, from a large start time. Session 2 sends half the growth of its time as dt_s, like a
  // Newmark host that wrongly sends gamma dt, with gamma = 1/2. Session 3 sends no times, session 4 times in ms.
  for (std::uint64_t sequence = 1; sequence <= 103; ++sequence) {
    const double steps = static_cast<double>(sequence);
    const double time[] = {1e-3 + steps * kDt, 2.0 * steps * kDt, 0.0, 1e3 * steps * kDt};
    for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}, std::uint8_t{3}, std::uint8_t{4}}) {
      Host host;
      const Answer answer =
          harness.granted(step_of(sequence, host.request(1), time[session - 1], wire::Mode::kAdvance, session));
      const bool warns = session % 2 == 0 && sequence > 1 && sequence <= 101;
      ASSERT_EQ(upscale(answer).warnings.size(), warns ? 1U : 0U) << int(session) << ", step " << sequence;
      if (warns) {
        EXPECT_THAT(upscale(answer).warnings[0], StartsWith("time_s: the host's time grew by "));
        EXPECT_THAT(upscale(answer).warnings[0], HasSubstr(session == 2 ? "grew by 2" : "time_s looks like ms"));
        EXPECT_THAT(upscale(answer).warnings[0], HasSubstr("dt_s is 1e-09 s"));
      }
    }
  }
}

// A host with a clock in single precision rounds its times: to 1e-7 of the time, which may be many parts of dt.
TEST(Closure, AClockInSinglePrecisionAgrees) {
  for (const double start : {0.0, 1e-6, 1e-4, 1e-3})
    for (const double unit : {1.0, 1e-3}) {  // in seconds, and in milliseconds
      ServiceHarness harness;
      harness.granted(opening(scene_of(1), true));
      harness.granted(opening(scene_of(1), true, 2));
      float clock = static_cast<float>(start / unit);
      for (std::uint64_t sequence = 1; sequence <= 100; ++sequence) {
        clock += static_cast<float>(kDt / unit);
        Host host;
        const double time = static_cast<double>(clock) * unit;
        const Answer answer = harness.granted(step_of(sequence, host.request(1), time));
        ASSERT_THAT(upscale(answer).warnings, IsEmpty()) << start << " s, step " << sequence;
        // The same clock of a host whose steps are twice as long as dt_s.
        const double twice = start + 2.0 * (time - start);
        const Answer wrong = harness.ask(step_of(sequence, host.request(1), twice, wire::Mode::kAdvance, 2));
        if (sequence == 1) continue;
        ASSERT_THAT(upscale(wrong).warnings, ElementsAre(StartsWith("time_s: ")));
      }
    }
}

}  // namespace
}  // namespace shearbus::service
