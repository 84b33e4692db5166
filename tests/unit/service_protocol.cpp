// The service as a function from request bytes to reply bytes, without a socket: sessions, sequences, repeats, trials.
#include <gtest/gtest.h>

#include <vector>

#include "tests/support/changed_scene.hpp"
#include "tests/support/service_harness.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::service {
namespace {

const std::vector<std::uint64_t> kNodes = support::node_ids(11);

wire::Batch columns(Strategy strategy, int step) {
  return support::step_columns(strategy, kNodes, step);
}

// A service with an open session.
struct Opened : ServiceHarness {
  explicit Opened(const v1::Scene& scene) { EXPECT_TRUE(ask(opening(scene, kNodes)).reply.status.ok()); }
};

class ServiceOf : public testing::TestWithParam<Strategy> {
 protected:
  v1::Scene scene() const { return support::scene_of(GetParam()); }
  wire::Batch columns(int step) const { return service::columns(GetParam(), step); }
};
INSTANTIATE_TEST_SUITE_P(Strategies, ServiceOf, support::both<Strategy>(), support::name_of_strategy);

TEST(Service, ClientsOfOtherMajorVersionsAreToldTheRange) {
  ServiceHarness harness;
  wire::Request request;
  request.body = wire::Hello{.oldest_major = 2, .newest_major = 3};
  const Answer answer = harness.ask(request);
  EXPECT_EQ(answer.code(), Code::kVersion);
  EXPECT_NE(answer.reply.status.text.find("2 to 3"), std::string::npos);
  EXPECT_NE(answer.reply.status.text.find("speaks 1"), std::string::npos);
}

TEST_P(ServiceOf, OpeningFillsTheSceneIn) {
  ServiceHarness harness;
  const Answer answer = harness.granted(ServiceHarness::opening(scene(), kNodes));
  const auto& opened = std::get<wire::SessionOpened>(answer.reply.body);
  EXPECT_EQ(answer.reply.session_id, ServiceHarness::id(1));
  const v1::Scene effective = scene::parse(opened.effective_scene, "effective").scene;
  EXPECT_GE(scene::numbers_of(effective.soft()).size(), 10u);
  EXPECT_EQ(opened.scene_name, scene().name());
  EXPECT_EQ(opened.strategy, GetParam());
  EXPECT_EQ(opened.tangential_components, 1u);
  const auto columns = wire::columns_of(GetParam());
  EXPECT_TRUE(std::ranges::equal(opened.required_columns, columns.required));
  EXPECT_TRUE(std::ranges::equal(opened.reply_columns, columns.reply));
  EXPECT_TRUE(opened.optional_columns.empty()) << "no slip drives the layer, and it does not flow";
  std::vector<Field> on_request = {Field::kMeanShearStress, Field::kStressPerJump, Field::kStressPerPressure,
                                   Field::kTimeToMelting};
  on_request.insert(on_request.end(), wire::kLedgerColumns.begin(), wire::kLedgerColumns.end());
  EXPECT_EQ(opened.columns_on_request, on_request);
  EXPECT_GT(opened.bytes_per_node, 24u * 2 * 8);
  const wire::ServerStatus status = harness.service.status();
  EXPECT_EQ(status.sessions, 1u);
  EXPECT_EQ(status.nodes, kNodes.size());
  // Bytes per node of the stored reply: the columns of 8 bytes, and one byte each for regime and outcome.
  const std::uint64_t reply_row = (GetParam() == Strategy::kForceDriven ? 5 : 4) * 8 + 2;
  EXPECT_EQ(status.state_bytes, 16 * (opened.bytes_per_node - reply_row));
  EXPECT_EQ(harness.log.size(), 1u);
}

TEST_P(ServiceOf, RepeatedOpeningOpensOneSession) {
  ServiceHarness harness;
  const auto opening = ServiceHarness::opening(scene(), kNodes);
  EXPECT_FALSE(harness.ask(opening).reply.replayed);
  const Answer again = harness.granted(opening);
  EXPECT_TRUE(again.reply.replayed);
  EXPECT_TRUE(std::holds_alternative<wire::SessionOpened>(again.reply.body));
  EXPECT_EQ(harness.service.status().sessions, 1u);
  // A request to open the same session with another scene is no repetition of the first request.
  auto other = scene();
  other.set_name("other");
  EXPECT_EQ(harness.ask(ServiceHarness::opening(other, kNodes)).code(), Code::kSequenceReused);
}

TEST_P(ServiceOf, WrongSequencesRunNothingAndSayWhereTheSessionStands) {
  Opened harness(scene()), twin(scene());
  for (Opened* h : {&harness, &twin})
    for (std::uint64_t s = 1; s <= 3; ++s) h->ask(ServiceHarness::step(s, columns(static_cast<int>(s))));
  using Case = std::pair<std::uint64_t, Code>;
  for (const auto& [sequence, code] :
       {Case{3, Code::kSequenceReused}, Case{2, Code::kStaleSequence}, Case{0, Code::kStaleSequence},
        Case{5, Code::kSequenceGap}, Case{~0ULL, Code::kSequenceGap}}) {
    const Answer answer = harness.ask(ServiceHarness::step(sequence, columns(50)));
    EXPECT_EQ(answer.code(), code) << sequence;
    EXPECT_EQ(answer.reply.status.last_sequence, 3u);
    EXPECT_TRUE(answer.reply.batch.columns().empty());
  }
  EXPECT_EQ(harness.ask(ServiceHarness::step(4, columns(4))).payload(),
            twin.ask(ServiceHarness::step(4, columns(4))).payload());
}

TEST_P(ServiceOf, TrialRollbackTrialCommitIsAdvance) {
  Opened direct(scene()), hesitant(scene());
  std::uint64_t sequence = 0;
  for (int step = 1; step <= 10; ++step) {
    const Answer expected = direct.ask(ServiceHarness::step(static_cast<std::uint64_t>(step), columns(step)));
    hesitant.ask(ServiceHarness::step(++sequence, columns(step + 70), Mode::kTrial));
    const Answer back = hesitant.ask(ServiceHarness::in_session(wire::Rollback{}, ++sequence));
    EXPECT_EQ(std::get<wire::RolledBack>(back.reply.body).state_version, static_cast<std::uint64_t>(step - 1));
    const Answer trial = hesitant.ask(ServiceHarness::step(++sequence, columns(step), Mode::kTrial));
    const Answer done = hesitant.ask(ServiceHarness::in_session(wire::Commit{}, ++sequence));
    EXPECT_EQ(trial.payload(), expected.payload());
    EXPECT_EQ(std::get<wire::Committed>(done.reply.body).state_version, static_cast<std::uint64_t>(step));
  }
}

TEST_P(ServiceOf, CommitCanRideOnTheNextTrial) {
  Opened direct(scene()), riding(scene());
  for (std::uint64_t step = 1; step <= 10; ++step) {
    const Answer expected = direct.ask(ServiceHarness::step(step, columns(static_cast<int>(step))));
    auto request = ServiceHarness::step(step, columns(static_cast<int>(step)), Mode::kTrial);
    std::get<wire::Downscale>(request.body).commit_previous = step > 1;
    EXPECT_EQ(riding.ask(request).payload(), expected.payload());
  }
}

TEST_P(ServiceOf, ARefusedStepDoesNotCommitThePreviousOne) {
  Opened harness(scene());
  harness.ask(ServiceHarness::step(1, columns(1), Mode::kTrial));
  auto request = ServiceHarness::step(2, columns(2), Mode::kTrial);
  auto& step = std::get<wire::Downscale>(request.body);
  step.commit_previous = true;
  step.dt_s = -1.0;
  EXPECT_EQ(harness.ask(request).code(), Code::kInvalidValue);
  const Answer back = harness.ask(ServiceHarness::in_session(wire::Rollback{}, 2));
  EXPECT_EQ(std::get<wire::RolledBack>(back.reply.body).state_version, 0u);
}

TEST_P(ServiceOf, ThereIsNothingToCommitWithoutATrial) {
  Opened harness(scene());
  EXPECT_EQ(harness.ask(ServiceHarness::in_session(wire::Commit{}, 1)).code(), Code::kNothingToCommit);
  harness.ask(ServiceHarness::step(1, columns(1)));
  EXPECT_EQ(harness.ask(ServiceHarness::in_session(wire::Commit{}, 2)).code(), Code::kNothingToCommit);
  auto request = ServiceHarness::step(2, columns(2), Mode::kTrial);
  std::get<wire::Downscale>(request.body).commit_previous = true;
  EXPECT_EQ(harness.ask(request).code(), Code::kNothingToCommit);
}

TEST_P(ServiceOf, TheEnergyLedgerIsAnsweredOnlyWhereItIsWanted) {
  Opened plain(scene()), asking(scene());
  double work = 0.0;
  for (int step = 1; step <= 5; ++step) {
    const auto sequence = static_cast<std::uint64_t>(step);
    wire::Request wanting = ServiceHarness::step(sequence, columns(step));
    std::vector<Field>& wanted = std::get<wire::Downscale>(wanting.body).wanted;
    wanted = {Field::kShearStress, Field::kFrictionHeat};
    wanted.insert(wanted.end(), wire::kLedgerColumns.begin(), wire::kLedgerColumns.end());
    const Answer without = plain.ask(ServiceHarness::step(sequence, columns(step)));
    const Answer with = asking.granted(wanting);
    for (const Field term : wire::kLedgerColumns) EXPECT_FALSE(without.reply.batch.has(term));
    EXPECT_TRUE(
        std::ranges::equal(with.reply.batch.f64(Field::kShearStress), without.reply.batch.f64(Field::kShearStress)));
    for (std::size_t row = 0; row < kNodes.size(); ++row) {
      const auto of = [&](Field field) { return with.reply.batch.f64(field)[row]; };
      // The scene conducts heat in the soft body only, so the fields heat_to_soft and friction_heat are both the share
      // of the soft body.
      ASSERT_EQ(of(Field::kHeatToSoft), of(Field::kFrictionHeat));
      ASSERT_NEAR(of(Field::kHeatResidual), 0.0, 1e-9 * (of(Field::kFrictionHeat) + 1.0));
      work += of(Field::kInterfaceWork);
    }
  }
  EXPECT_GT(work, 0.0);
}

TEST_P(ServiceOf, TheErrorEstimateIsToldOfScenesWithATolerance) {
  v1::Scene controlled = scene();
  controlled.clear_layer();
  controlled.set_tolerance(1e-3);
  Opened harness(controlled), plain(scene());
  wire::Request wanting = ServiceHarness::step(1, columns(1));
  std::get<wire::Downscale>(wanting.body).wanted = {Field::kInterfaceTemperature, Field::kErrorEstimate};
  const Answer answer = harness.granted(wanting);
  double largest = 0.0;
  for (const double estimate : answer.reply.batch.f64(Field::kErrorEstimate)) {
    EXPECT_TRUE(estimate >= 0.0 && estimate <= 1e-3) << estimate;
    largest = std::max(largest, estimate);
  }
  EXPECT_GT(largest, 0.0);
  const Answer refused = plain.ask(wanting);
  EXPECT_EQ(refused.code(), Code::kUnsupported);
  EXPECT_NE(refused.reply.status.text.find("error_estimate"), std::string::npos);

  wire::Request shorter = ServiceHarness::step(2, columns(2));
  std::get<wire::Downscale>(shorter.body).dt_s = 1e-13;
  EXPECT_EQ(harness.ask(shorter).reply.status.field, "dt_s");
}

// Column 37: nobody gets it without asking; asked for, it comes with the same bytes in every other column.
TEST_P(ServiceOf, TheMeanStressIsToldOnRequest) {
  Opened harness(scene()), plain(scene());
  for (int n = 1; n <= 3; ++n) {
    wire::Request wanting = ServiceHarness::step(static_cast<std::uint64_t>(n), columns(n));
    const Answer without = plain.ask(wanting);
    auto& wanted = std::get<wire::Downscale>(wanting.body).wanted;
    const auto reply = wire::columns_of(GetParam()).reply;
    wanted.assign(reply.begin(), reply.end());
    wanted.push_back(Field::kMeanShearStress);
    wanted.insert(wanted.end(), {Field::kStressPerJump, Field::kStressPerPressure, Field::kTimeToMelting});
    const Answer answer = harness.granted(wanting);
    EXPECT_FALSE(without.reply.batch.has(Field::kMeanShearStress));
    const std::span<const double> stress = answer.reply.batch.f64(Field::kShearStress);
    const std::span<const double> mean = answer.reply.batch.f64(Field::kMeanShearStress);
    EXPECT_TRUE(std::ranges::equal(stress, without.reply.batch.f64(Field::kShearStress)));
    EXPECT_EQ(std::ranges::equal(mean, stress), GetParam() == Strategy::kForceDriven);
    for (std::size_t row = 0; row < mean.size(); ++row) EXPECT_LE(std::abs(mean[row]), 1.5 * std::abs(stress[row]));
    EXPECT_TRUE(
        std::ranges::any_of(answer.reply.batch.f64(Field::kStressPerJump), [](double value) { return value != 0.0; }));
    EXPECT_TRUE(
        std::ranges::all_of(answer.reply.batch.f64(Field::kTimeToMelting), [](double value) { return value > 0.0; }));
  }
  wire::Request missing = ServiceHarness::step(4, columns(4));
  std::get<wire::Downscale>(missing.body).wanted = {Field::kMeanShearStress};
  EXPECT_EQ(harness.ask(missing).reply.batch.f64(Field::kMeanShearStress).size(), kNodes.size());
  if (GetParam() == Strategy::kForceDriven) return;
  v1::Scene waves = scene();
  waves.mutable_layer()->set_inertia(true);
  Opened other(waves);
  std::get<wire::Downscale>(missing.body).wanted = {Field::kMeanShearStress, Field::kMeanFarStress};
  missing.sequence = 1;
  const Answer both = other.granted(missing);
  EXPECT_FALSE(
      std::ranges::equal(both.reply.batch.f64(Field::kMeanShearStress), both.reply.batch.f64(Field::kMeanFarStress)));
  missing.sequence = 5;
  const Answer refused = harness.ask(missing);
  EXPECT_EQ(refused.code(), Code::kUnsupported);
  EXPECT_NE(refused.reply.status.text.find("mean_far_stress"), std::string::npos) << refused.reply.status.text;
  missing.sequence = 2;
  std::get<wire::Downscale>(missing.body).wanted = {Field::kStressPerPressure};
  EXPECT_EQ(other.ask(missing).code(), Code::kUnsupported);
  std::get<wire::Downscale>(missing.body).wanted = {Field::kTimeToMelting};
  EXPECT_TRUE(other.ask(missing).reply.status.ok());
}

TEST(Service, TheThicknessOfAMeltFilmIsToldWhereItIsAskedForAndRefusedInOtherScenes) {
  ServiceHarness harness, plain;
  harness.granted(ServiceHarness::opening(
      support::with(support::force_scene(),
                    "melt_film { latent_heat_j_per_kg: 397e3 viscosity_pa_s: 1.25e-3 } hard_layer {}"),
      kNodes));
  plain.granted(ServiceHarness::opening(support::force_scene(), kNodes));
  wire::Request step = ServiceHarness::step(1, support::step_columns(Strategy::kForceDriven, kNodes, 1, true));
  std::get<wire::Downscale>(step.body).wanted = {Field::kFilmThickness};
  const Answer answer = harness.granted(step);
  EXPECT_TRUE(std::ranges::all_of(answer.reply.batch.f64(Field::kFilmThickness), [](double x) { return x == 0.0; }));
  const Answer refused = plain.ask(step);
  EXPECT_EQ(refused.code(), Code::kUnsupported);
  EXPECT_NE(refused.reply.status.text.find("nothing melts"), std::string::npos);
  step.sequence = 2;
  std::get<wire::Downscale>(step.body).wanted = {Field::kStressPerJump};
  EXPECT_EQ(harness.ask(step).code(), Code::kUnsupported);
}

TEST_P(ServiceOf, AStepOfNoNodesIsAnEmptyAnswer) {
  Opened harness(scene());
  const Answer answer = harness.granted(ServiceHarness::step(1, support::step_columns(GetParam(), {}, 1, true)));
  EXPECT_EQ(std::get<wire::Upscale>(answer.reply.body).nodes, 0u);
}

TEST_P(ServiceOf, ClosingFreesTheStatesAndIsAnsweredAgain) {
  ServiceHarness harness;
  const auto opening = ServiceHarness::opening(scene(), kNodes);
  harness.ask(opening);
  harness.ask(ServiceHarness::step(1, columns(1)));
  const auto goodbye = ServiceHarness::in_session(wire::CloseSession{.reason = "done"}, 2);
  const Answer closed = harness.ask(goodbye);
  const auto totals = std::get<wire::SessionClosed>(closed.reply.body);
  EXPECT_EQ(totals.requests, 2u);
  EXPECT_EQ(totals.node_steps, kNodes.size());
  EXPECT_EQ(harness.service.status().sessions, 0u);
  EXPECT_EQ(harness.service.status().nodes, 0u);
  EXPECT_EQ(harness.service.status().state_bytes, 0u);
  EXPECT_TRUE(harness.ask(goodbye).reply.replayed);
  EXPECT_EQ(harness.ask(ServiceHarness::step(3, columns(3))).code(), Code::kUnknownSession);
  // A late copy of the request that opened the session must not open the closed session again.
  EXPECT_EQ(harness.ask(opening).code(), Code::kStaleSequence);
  EXPECT_EQ(harness.service.status().sessions, 0u);
}

TEST(Service, ClosedSessionsAreForgottenInTheEnd) {
  ServiceHarness harness;
  const std::vector<std::uint64_t> node = {1};
  const auto scene = support::velocity_scene(2);
  for (int round = 0; round < 600; ++round) {
    auto opening = ServiceHarness::opening(scene, node);
    auto& id = std::get<wire::OpenSession>(opening.body).session_id;
    id[0] = static_cast<std::uint8_t>(round);
    id[1] = static_cast<std::uint8_t>(round >> 8);
    harness.granted(opening);
    auto goodbye = ServiceHarness::in_session(wire::CloseSession{}, 1);
    goodbye.session_id = id;
    harness.granted(goodbye);
    ASSERT_TRUE(harness.ask(goodbye).reply.replayed);
  }
  EXPECT_EQ(harness.ask(ServiceHarness::in_session(wire::CloseSession{}, 1, 0)).code(), Code::kUnknownSession);
}

// The server computes a step in the memory of an earlier reply, which may be another session's and of another size.
TEST_P(ServiceOf, AReplyHoldsNothingOfTheRepliesBeforeIt) {
  const auto many = support::node_ids(21), few = support::node_ids(19);
  ServiceHarness both, first, second;
  for (ServiceHarness* harness : {&both, &first}) harness->ask(ServiceHarness::opening(scene(), many, 1));
  for (ServiceHarness* harness : {&both, &second}) harness->ask(ServiceHarness::opening(scene(), few, 2));
  for (int step = 1; step <= 12; ++step) {
    const auto asked = [&](ServiceHarness& harness, const std::vector<std::uint64_t>& ids, std::uint8_t session) {
      wire::Request request =
          ServiceHarness::step(static_cast<std::uint64_t>(step), support::step_columns(GetParam(), ids, step),
                               wire::Mode::kAdvance, session);
      if (step % 3 == 0)
        std::get<wire::Downscale>(request.body).wanted = {wire::Field::kOutcome, wire::Field::kShearStress};
      return harness.ask(request).payload();
    };
    EXPECT_EQ(asked(both, many, 1), asked(first, many, 1)) << step;
    EXPECT_EQ(asked(both, few, 2), asked(second, few, 2)) << step;
  }
}

TEST_P(ServiceOf, AFaultInsideTheServerIsAReplyAndChangesNothing) {
  Opened harness(scene()), twin(scene());
  harness.clock_fails = true;
  const Answer fault = harness.ask(ServiceHarness::step(1, columns(1)));
  EXPECT_EQ(fault.code(), Code::kInternal);
  EXPECT_NE(fault.reply.status.text.find("the clock stands still"), std::string::npos);
  EXPECT_EQ(harness.ask(ServiceHarness::step(1, columns(1))).payload(),
            twin.ask(ServiceHarness::step(1, columns(1))).payload());
}

TEST(Service, RequestsForAnEarlierServerAreToldOfTheRestart) {
  Opened harness(support::velocity_scene());
  auto request = ServiceHarness::step(1, columns(Strategy::kVelocityDriven, 1));
  request.epoch = 76;
  EXPECT_EQ(harness.ask(request).code(), Code::kEpoch);
  request.epoch = 77;
  EXPECT_TRUE(harness.ask(request).reply.status.ok());
}

TEST(Service, NoNewWorkWhileShuttingDown) {
  Opened harness(support::velocity_scene());
  harness.service.begin_shutdown();
  EXPECT_EQ(harness.ask(ServiceHarness::step(1, columns(Strategy::kVelocityDriven, 1))).code(), Code::kShuttingDown);
}

TEST(Service, SessionAndMemoryLimitsAreHeld) {
  const std::vector<std::uint64_t> nodes = support::node_ids(64);
  ServiceHarness few(1, {.max_sessions = 1});
  EXPECT_TRUE(few.ask(ServiceHarness::opening(support::velocity_scene(), nodes, 1)).reply.status.ok());
  EXPECT_EQ(few.ask(ServiceHarness::opening(support::velocity_scene(), nodes, 2)).code(), Code::kLimit);
  few.ask(ServiceHarness::in_session(wire::CloseSession{}, 1, 1));
  EXPECT_TRUE(few.ask(ServiceHarness::opening(support::velocity_scene(), nodes, 2)).reply.status.ok());

  ServiceHarness small(1, {.max_state_bytes = 1 << 20});
  EXPECT_TRUE(small.ask(ServiceHarness::opening(support::velocity_scene(60), nodes, 1)).reply.status.ok());
  auto fine = support::velocity_scene(1000);
  fine.mutable_layer()->set_grading(1.0);
  const Answer refused = small.ask(ServiceHarness::opening(fine, nodes, 2));
  EXPECT_EQ(refused.code(), Code::kLimit);
  EXPECT_NE(refused.reply.status.text.find("64 nodes"), std::string::npos);
}

TEST(Service, LogLinesStayOneLine) {
  ServiceHarness harness;
  auto scene = support::velocity_scene();
  scene.set_name("first\nsecond\x1b[31m");
  EXPECT_EQ(harness.ask(ServiceHarness::opening(scene, kNodes)).code(), Code::kInvalidScene);
  scene.set_name("first second");
  EXPECT_EQ(harness.ask(ServiceHarness::opening(scene, kNodes)).code(), Code::kOk);
  ASSERT_EQ(harness.log.size(), 1u);
  EXPECT_EQ(harness.log[0].find('\n'), std::string::npos);
  EXPECT_EQ(harness.log[0].find('\x1b'), std::string::npos);
}

}  // namespace
}  // namespace shearbus::service
