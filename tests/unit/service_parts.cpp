// Steps in parts, which have the bits of the undivided step and are committed as one; steps that do not name all nodes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <vector>

#include "proto/wire/limits.hpp"
#include "tests/support/service_harness.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::service {
namespace {

using ::testing::HasSubstr;

const std::vector<std::uint64_t> kNodes = support::node_ids(45);

struct PartOf {
  std::uint32_t part = 0;
  std::uint32_t parts = 0;
  int step = 1;
  Mode mode = Mode::kAdvance;
  wire::Policy policy = wire::Policy::kAccept;
  wire::AbsentNodes absent = wire::AbsentNodes::kKeep;
};

wire::Request part_of(Strategy strategy, std::uint64_t sequence, std::span<const std::uint64_t> ids, const PartOf& part,
                      std::uint8_t session = 1) {
  wire::Request request =
      ServiceHarness::step(sequence, support::step_columns(strategy, ids, part.step, true), part.mode, session);
  auto& body = std::get<wire::Downscale>(request.body);
  body.part = part.part;
  body.parts = part.parts;
  body.policy = part.policy;
  body.absent_nodes = part.absent;
  return request;
}

class Steps : public testing::TestWithParam<Strategy> {
 protected:
  // Opens sessions 1 and 2.
  void open(ServiceHarness& harness, const v1::Scene& scene) const {
    for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}})
      harness.granted(ServiceHarness::opening(scene, kNodes, session));
  }
  // Returns the answer of all nodes to one more step. Sessions with equal states have equal answers.
  std::vector<std::byte> probe(ServiceHarness& harness, std::uint64_t sequence, std::uint8_t session,
                               std::span<const std::uint64_t> nodes = kNodes) const {
    return harness
        .granted(ServiceHarness::step(sequence, support::step_columns(GetParam(), nodes, 99), Mode::kAdvance, session))
        .payload();
  }
};

class Parts : public Steps {
 protected:
  using Steps::open;
  void open(ServiceHarness& harness) const { open(harness, support::scene_of(GetParam())); }
  std::uint64_t version(const Answer& answer) const { return std::get<wire::Upscale>(answer.reply.body).state_version; }
};
INSTANTIATE_TEST_SUITE_P(Strategies, Parts, support::both<Strategy>(), support::name_of_strategy);

TEST_P(Parts, HaveTheBitsOfTheUndividedStepHoweverItIsDivided) {
  std::mt19937 random(7);
  for (const unsigned threads : {1U, 4U})
    for (const wire::Policy policy : {wire::Policy::kAccept, wire::Policy::kAllOrNothing})
      for (const wire::AbsentNodes absent : {wire::AbsentNodes::kKeep, wire::AbsentNodes::kOpen}) {
        ServiceHarness harness(threads, {.nodes_per_task = 4});
        open(harness);
        std::uint64_t sequence = 0, undivided_sequence = 0;
        for (int step = 1; step <= 12; ++step) {
          std::vector<std::uint64_t> ids = kNodes;
          std::ranges::shuffle(ids, random);
          ids.resize(ids.size() - random() % 6);
          const auto parts = static_cast<std::uint32_t>(1 + random() % 6);
          std::vector<std::size_t> cuts = {0, ids.size()};
          while (cuts.size() < parts + 1) cuts.push_back(random() % (ids.size() + 1));
          std::ranges::sort(cuts);
          const Mode mode = step % 3 == 0 ? Mode::kTrial : Mode::kAdvance;
          const PartOf whole{.step = step, .mode = mode, .policy = policy, .absent = absent};
          const Answer undivided = harness.granted(part_of(GetParam(), ++undivided_sequence, ids, whole, 2));
          for (std::uint32_t part = 1; part <= parts; ++part) {
            PartOf one = whole;
            one.part = part;
            one.parts = parts;
            const std::size_t first = cuts[part - 1], rows = cuts[part] - first;
            const Answer answer =
                harness.granted(part_of(GetParam(), ++sequence, std::span(ids).subspan(first, rows), one));
            for (const wire::Column& column : answer.reply.batch.columns())
              for (std::size_t row = 0; row < rows && column.element == wire::Element::kFloat64; ++row)
                ASSERT_EQ(std::as_const(answer.reply.batch).f64(column.field)[row],
                          std::as_const(undivided.reply.batch).f64(column.field)[first + row]);
            ASSERT_EQ(version(answer), version(undivided) - (mode == Mode::kAdvance && part < parts ? 1 : 0));
          }
          if (mode == Mode::kAdvance) continue;
          for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}})
            harness.granted(
                ServiceHarness::in_session(wire::Commit{}, session == 1 ? ++sequence : ++undivided_sequence, session));
        }
        EXPECT_EQ(probe(harness, ++sequence, 1), probe(harness, ++undivided_sequence, 2))
            << "the states have the same bits";
        const auto totals = [&](std::uint64_t number, std::uint8_t session) {
          const Answer closed = harness.ask(ServiceHarness::in_session(wire::CloseSession{}, number, session));
          return std::get<wire::SessionClosed>(closed.reply.body).node_steps;
        };
        EXPECT_EQ(totals(++sequence, 1), totals(++undivided_sequence, 2));
      }
}

TEST_P(Parts, UntilTheLastNothingIsCommittedAndWhatIsNotTheNextPartDropsThem) {
  const std::span<const std::uint64_t> ids(kNodes);
  const auto first = ids.first(20), rest = ids.subspan(20);
  for (const int ending : {0, 1, 2}) {
    ServiceHarness harness;
    open(harness);
    harness.granted(part_of(GetParam(), 1, first, {.part = 1, .parts = 2}));
    EXPECT_EQ(harness.ask(ServiceHarness::in_session(wire::Commit{}, 2)).code(), Code::kNothingToCommit);
    wire::Request too_early = part_of(GetParam(), 2, first, {.part = 1, .parts = 2});
    std::get<wire::Downscale>(too_early.body).commit_previous = true;
    EXPECT_EQ(harness.ask(too_early).code(), Code::kNothingToCommit);
    std::uint64_t sequence = 2;
    if (ending == 0) {
      harness.granted(ServiceHarness::in_session(wire::Rollback{}, sequence++));
      EXPECT_EQ(harness.ask(part_of(GetParam(), sequence, rest, {.part = 2, .parts = 2})).code(), Code::kInvalidValue);
      harness.granted(part_of(GetParam(), 1, ids, {}, 2));
      harness.granted(part_of(GetParam(), sequence++, ids, {}));
    } else if (ending == 1) {  // an undivided step
      harness.granted(part_of(GetParam(), sequence++, rest, {.step = 3}));
      harness.granted(part_of(GetParam(), 1, rest, {.step = 3}, 2));
    } else {  // the step begins again
      harness.granted(part_of(GetParam(), sequence++, rest, {.part = 1, .parts = 2}));
      const Answer last = harness.granted(part_of(GetParam(), sequence++, first, {.part = 2, .parts = 2}));
      EXPECT_EQ(version(last), 1u);
      harness.granted(part_of(GetParam(), 1, ids, {}, 2));
    }
    EXPECT_EQ(probe(harness, sequence, 1), probe(harness, 2, 2)) << "ending " << ending;
  }
}

TEST_P(Parts, ARefusedPartChangesNothingAndThePartsBeforeStand) {
  const std::span<const std::uint64_t> ids(kNodes);
  const auto first = ids.first(20), rest = ids.subspan(20);
  ServiceHarness harness;
  open(harness);
  harness.granted(part_of(GetParam(), 1, ids, {}, 2));
  const PartOf one{.part = 1, .parts = 3}, two{.part = 2, .parts = 3}, three{.part = 3, .parts = 3};
  const auto refused = [&](wire::Request request, Code code, const std::string& text) {
    const Answer answer = harness.ask(request);
    EXPECT_EQ(answer.code(), code) << describe(answer.reply.status);
    EXPECT_THAT(describe(answer.reply.status), HasSubstr(text));
  };
  const auto part = [&](std::uint64_t sequence, std::span<const std::uint64_t> rows, const PartOf& which) {
    return part_of(GetParam(), sequence, rows, which);
  };
  const auto changed = [&](auto change) {
    wire::Request request = part(2, rest.first(10), two);
    change(std::get<wire::Downscale>(request.body));
    return request;
  };
  refused(part(1, first, two), Code::kInvalidValue, "no step in parts has begun");
  refused(part(1, first, {.part = 4, .parts = 3}), Code::kInvalidValue, "part 4 of 3");
  refused(part(1, first, {.part = 0, .parts = 3}), Code::kInvalidValue, "part 0 of 3");
  wire::Request all = ServiceHarness::step(1, support::step_columns(GetParam(), kNodes, 1));
  std::get<wire::Downscale>(all.body).part = std::get<wire::Downscale>(all.body).parts = 1;
  refused(std::move(all), Code::kShape, "no column node_id");

  harness.granted(part(1, first, one));
  refused(part(2, rest, three), Code::kInvalidValue, "expected part 2");
  refused(changed([](auto& body) { body.parts = 4; }), Code::kInvalidValue, "parts of part 2");
  refused(changed([](auto& body) { body.dt_s *= 2; }), Code::kInvalidValue, "dt_s");
  refused(changed([](auto& body) { body.time_s = 1; }), Code::kInvalidValue, "time_s");
  refused(changed([](auto& body) { body.step = 1; }), Code::kInvalidValue, "step");
  refused(changed([](auto& body) { body.attempt = 1; }), Code::kInvalidValue, "attempt");
  refused(changed([](auto& body) { body.mode = Mode::kTrial; }), Code::kInvalidValue, "mode");
  refused(changed([](auto& body) { body.policy = wire::Policy::kAllOrNothing; }), Code::kInvalidValue, "policy");
  refused(changed([](auto& body) { body.absent_nodes = wire::AbsentNodes::kOpen; }), Code::kInvalidValue, "absent");
  refused(changed([](auto& body) { body.commit_previous = true; }), Code::kInvalidValue, "commit_previous");
  refused(part(2, ids.subspan(19, 5), two), Code::kDuplicateNode, std::to_string(kNodes[19]));
  refused(ServiceHarness::of_nodes(wire::RetireNodes{}, std::span(kNodes).first(1), 2), Code::kTrialStands, "");

  harness.granted(part(2, rest.first(10), two));
  refused(part(3, rest, three), Code::kDuplicateNode, std::to_string(rest[0]));
  const Answer last = harness.granted(part(3, rest.subspan(10), three));
  EXPECT_EQ(version(last), 1u);
  EXPECT_EQ(probe(harness, 4, 1), probe(harness, 2, 2));
}

TEST_P(Parts, OfWhichOneWasSentAheadAreBothAnsweredAgain) {
  ServiceHarness harness;
  open(harness);
  const std::span<const std::uint64_t> ids(kNodes);
  const auto part = [&](std::uint32_t number) {
    return part_of(GetParam(), number, ids.subspan(15 * (number - 1), 15), {.part = number, .parts = 3});
  };
  const wire::Request first = part(1), second = ServiceHarness::ahead(part(2), first),
                      third = ServiceHarness::ahead(part(3), second);
  const Answer one = harness.ask(first);
  const Answer two = harness.granted(second);
  for (int i = 0; i < 2; ++i) {
    EXPECT_TRUE(harness.ask(first).reply.replayed);
    EXPECT_EQ(harness.ask(first).payload(), one.payload());
    EXPECT_EQ(harness.ask(second).payload(), two.payload());
  }
  harness.granted(third);
  EXPECT_EQ(harness.ask(first).code(), Code::kStaleSequence) << "its client has had the answer before it sent part 3";
  EXPECT_EQ(harness.ask(second).payload(), two.payload());
  harness.granted(part_of(GetParam(), 1, ids, {}, 2));
  EXPECT_EQ(probe(harness, 4, 1), probe(harness, 2, 2));
}

TEST_P(Parts, SentAheadRunBehindTheirOwnPartOnly) {
  ServiceHarness harness;
  open(harness);
  const std::span<const std::uint64_t> ids(kNodes);
  const auto whole = [&](int step, std::uint32_t number) {
    return part_of(GetParam(), number, ids.subspan(20 * (number - 1), number == 1 ? 20 : 25),
                   {.part = number, .parts = 2, .step = step});
  };
  wire::Request given_up = whole(1, 1);
  const wire::Request late = ServiceHarness::ahead(whole(1, 2), given_up);
  EXPECT_EQ(harness.ask(late).code(), Code::kSequenceGap) << "it has overtaken the part before";
  given_up.batch.f64(Field::kPressure)[3] = -std::numeric_limits<double>::infinity();
  EXPECT_EQ(harness.ask(given_up).code(), Code::kInvalidValue);
  EXPECT_EQ(harness.ask(late).code(), Code::kSequenceGap);
  // Its client takes another step under the same numbers.
  wire::Request renamed = whole(1, 1);
  renamed.request_id += 1;
  harness.granted(renamed);
  const Answer refused = harness.ask(late);
  EXPECT_EQ(refused.code(), Code::kSequenceGap);
  EXPECT_EQ(refused.reply.status.field, "downscale.follows");
  harness.granted(ServiceHarness::ahead(whole(1, 2), renamed));
  wire::Request begins = part_of(GetParam(), 3, ids, {.part = 1, .parts = 2});
  EXPECT_EQ(harness.ask(ServiceHarness::ahead(std::move(begins), late)).code(), Code::kInvalidValue)
      << "a first part follows nothing";
  harness.granted(part_of(GetParam(), 1, ids, {}, 2));
  EXPECT_EQ(probe(harness, 3, 1), probe(harness, 2, 2));
  const Answer welcome = harness.ask({.body = wire::Hello{}});
  EXPECT_THAT(std::get<wire::Welcome>(welcome.reply.body).capabilities, testing::Contains("parts_ahead"));
}

TEST_P(Parts, AMessageHasAtMostAsManyRowsAsTheWelcomeSays) {
  ServiceHarness harness;
  const auto many = support::node_ids(wire::kMaxRowsPerMessage + 1);
  v1::Scene scene = support::scene_of(GetParam());
  scene.mutable_layer()->set_cells(4);
  harness.granted(ServiceHarness::opening(scene, many));
  const Answer all = harness.ask(ServiceHarness::step(1, support::step_columns(GetParam(), many, 1)));
  EXPECT_EQ(all.code(), Code::kLimit);
  EXPECT_THAT(describe(all.reply.status), HasSubstr("Divide the step into parts"));
  const Answer welcome = harness.ask({.body = wire::Hello{}});
  EXPECT_EQ(std::get<wire::Welcome>(welcome.reply.body).limits.max_rows_per_message, wire::kMaxRowsPerMessage);
  EXPECT_THAT(std::get<wire::Welcome>(welcome.reply.body).capabilities, testing::Contains("parts"));
}

// ---- Nodes that a step does not name: with absent_nodes = open they are stepped as open contacts ----

std::vector<std::uint64_t> named_in(int step) {
  std::vector<std::uint64_t> ids;
  for (const std::uint64_t id : kNodes)
    if ((id + static_cast<std::uint64_t>(step)) % 3 == 0) ids.push_back(id);
  std::ranges::reverse(ids);
  return ids;
}

// Returns the columns of the nodes that the step names, followed by all other nodes with P = 0, jump 0 and no stress.
wire::Batch with_open_nodes(Strategy strategy, std::span<const std::uint64_t> nodes, int step) {
  std::vector<std::uint64_t> ids = named_in(step);
  const std::size_t named = ids.size();
  for (const std::uint64_t id : nodes)
    if (std::ranges::count(ids, id) == 0) ids.push_back(id);
  wire::Batch batch = support::step_columns(strategy, ids, step, true);
  for (const wire::Column& column : batch.columns())
    if (column.field != Field::kNodeId && column.field != Field::kMassSoft && column.field != Field::kMassHard)
      for (std::size_t row = named; row < ids.size(); ++row) batch.f64(column.field)[row] = 0.0;
  return batch;
}

wire::Request step_of(std::uint64_t sequence, wire::Batch batch, std::uint8_t session, wire::AbsentNodes absent,
                      wire::Mode mode = Mode::kAdvance, wire::Policy policy = wire::Policy::kAccept) {
  wire::Request request = ServiceHarness::step(sequence, std::move(batch), mode, session);
  auto& body = std::get<wire::Downscale>(request.body);
  body.absent_nodes = absent;
  body.policy = policy;
  return request;
}

class AbsentNodes : public Steps {
 protected:
  v1::Scene scene() const {
    v1::Scene scene = support::scene_of(GetParam());
    scene.mutable_layer()->set_initial_temperature_k(400.0);
    return scene;
  }
};
INSTANTIATE_TEST_SUITE_P(Strategies, AbsentNodes, support::both<Strategy>(), support::name_of_strategy);

TEST_P(AbsentNodes, OpenHasTheBitsOfNamingThemWithoutPressure) {
  for (const unsigned threads : {1U, 4U})
    for (const wire::Policy policy : {wire::Policy::kAccept, wire::Policy::kAllOrNothing}) {
      ServiceHarness harness(threads, {.nodes_per_task = 4});
      open(harness, scene());
      // Two nodes retire, so that the slot of a node in the shard differs from its row in a request.
      std::vector<std::uint64_t> nodes = kNodes;
      for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}}) {
        const std::vector<std::uint64_t> retiring = {kNodes[1], kNodes[4]};
        harness.granted(ServiceHarness::of_nodes(wire::RetireNodes{}, retiring, 1, session));
      }
      nodes.erase(nodes.begin() + 4);
      nodes.erase(nodes.begin() + 1);
      for (std::uint64_t sequence = 2; sequence <= 12; ++sequence) {
        const int step = 2 + 3 * static_cast<int>(sequence);  // a step that names none of the retired nodes
        const std::vector<std::uint64_t> ids = named_in(step);
        ASSERT_EQ(std::ranges::count(ids, kNodes[1]) + std::ranges::count(ids, kNodes[4]), 0);
        const Answer open = harness.ask(step_of(sequence, support::step_columns(GetParam(), ids, step, true), 1,
                                                wire::AbsentNodes::kOpen, Mode::kAdvance, policy));
        const Answer named = harness.ask(step_of(sequence, with_open_nodes(GetParam(), nodes, step), 2,
                                                 wire::AbsentNodes::kKeep, Mode::kAdvance, policy));
        ASSERT_TRUE(open.reply.status.ok()) << describe(open.reply.status);
        ASSERT_TRUE(named.reply.status.ok()) << describe(named.reply.status);
        EXPECT_EQ(std::get<wire::Upscale>(open.reply.body).nodes, ids.size());
        for (const wire::Column& column : open.reply.batch.columns())
          for (std::size_t row = 0; row < ids.size() && column.element == wire::Element::kFloat64; ++row)
            ASSERT_EQ(std::as_const(open.reply.batch).f64(column.field)[row],
                      std::as_const(named.reply.batch).f64(column.field)[row]);
      }
      EXPECT_EQ(probe(harness, 13, 1, nodes), probe(harness, 13, 2, nodes)) << "the states have the same bits";
    }
}

TEST_P(AbsentNodes, KeepIsTheDefaultAndDoesNotCool) {
  ServiceHarness harness;
  for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}}) {
    harness.granted(ServiceHarness::opening(scene(), kNodes, session));
    harness.granted(ServiceHarness::step(1, support::step_columns(GetParam(), kNodes, 1), Mode::kAdvance, session));
  }
  const std::vector<std::uint64_t> first = {kNodes[0]};
  for (std::uint64_t sequence = 2; sequence <= 5; ++sequence) {
    const wire::Batch batch = support::step_columns(GetParam(), first, 1, true);
    for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}})
      harness.granted(step_of(sequence, wire::Batch::over(batch.columns(), batch.bytes()), session,
                              session == 1 ? wire::AbsentNodes::kKeep : wire::AbsentNodes::kOpen));
  }
  const auto temperatures = [&](std::uint8_t session) {
    wire::Batch batch = support::step_columns(GetParam(), kNodes, 1);
    std::ranges::fill(batch.f64(Field::kPressure), 0.0);
    wire::Request request = ServiceHarness::step(6, std::move(batch), Mode::kAdvance, session);
    std::get<wire::Downscale>(request.body).dt_s = 1e-18;  // too short for a change of the temperature
    const Answer answer = harness.ask(request);
    const auto column = std::as_const(answer.reply.batch).f64(Field::kInterfaceTemperature);
    return std::vector<double>(column.begin(), column.end());
  };
  const auto kept = temperatures(1), cooled = temperatures(2);
  int cooler = 0;
  for (std::size_t row = 1; row < kNodes.size(); ++row) cooler += cooled[row] < kept[row] - 0.1;
  EXPECT_NEAR(cooled[0], kept[0], 1e-9);
  EXPECT_GT(cooler, 10);
}

TEST_P(AbsentNodes, ATrialOfOpenNodesIsRolledBackWithTheOthers) {
  ServiceHarness harness;
  open(harness, scene());
  const auto step = [&](std::uint64_t sequence, std::uint8_t session, int number, wire::Mode mode) {
    const Answer answer =
        harness.granted(step_of(sequence, support::step_columns(GetParam(), named_in(number), number, true), session,
                                wire::AbsentNodes::kOpen, mode));
  };
  step(1, 1, 1, Mode::kAdvance);
  step(1, 2, 1, Mode::kAdvance);
  step(2, 1, 2, Mode::kTrial);
  harness.granted(ServiceHarness::in_session(wire::Rollback{}, 3, 1));
  step(4, 1, 5, Mode::kTrial);
  harness.granted(ServiceHarness::in_session(wire::Commit{}, 5, 1));
  step(2, 2, 5, Mode::kAdvance);
  EXPECT_EQ(probe(harness, 6, 1, kNodes), probe(harness, 3, 2, kNodes));
}

TEST_P(AbsentNodes, AStepWithoutRowsOpensAllNodes) {
  ServiceHarness harness;
  open(harness, scene());
  const Answer none =
      harness.granted(step_of(1, support::step_columns(GetParam(), {}, 1, true), 1, wire::AbsentNodes::kOpen));
  wire::Batch all = support::step_columns(GetParam(), kNodes, 1);
  for (const wire::Column& column : all.columns())
    if (column.field != Field::kMassSoft && column.field != Field::kMassHard)
      std::ranges::fill(all.f64(column.field), 0.0);
  harness.granted(ServiceHarness::step(1, std::move(all), Mode::kAdvance, 2));
  EXPECT_EQ(probe(harness, 2, 1, kNodes), probe(harness, 2, 2, kNodes));
  const Answer closed = harness.ask(ServiceHarness::in_session(wire::CloseSession{}, 3, 1));
  EXPECT_EQ(std::get<wire::SessionClosed>(closed.reply.body).node_steps, 2 * kNodes.size());
}

}  // namespace
}  // namespace shearbus::service
