// Tests sleeping nodes through the service: counters, trials, marks, and moves of nodes between sessions.
#include <gtest/gtest.h>

#include <algorithm>
#include <variant>
#include <vector>

#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

constexpr std::size_t kNodes = 21;  // three tiles of 8 nodes, the last one partly filled

v1::Scene sleepy_scene() {
  v1::Scene scene = support::force_scene();
  scene.mutable_layer()->set_sleep(true);
  return scene;
}

// Input columns of a step: in the first five steps all nodes slide; afterwards every fourth node is a closed contact
// and the others are open.
wire::Batch columns(std::span<const std::uint64_t> ids, int step, bool with_ids = false) {
  wire::Batch batch = support::step_columns(wire::Strategy::kForceDriven, ids, 0, with_ids);
  for (std::size_t row = 0; row < ids.size(); ++row)
    batch.f64(Field::kPressure)[row] = step < 5 || ids[row] % 4 == 0 ? 6e9 : -1.0;
  return batch;
}

struct Host {
  explicit Host(const v1::Scene& scene) : ids(support::node_ids(kNodes)) {
    harness.ask(ServiceHarness::opening(scene, ids));
  }
  Answer step(Mode mode = Mode::kAdvance) {
    ++sequence;
    Answer answer = harness.granted(ServiceHarness::step(sequence, columns(ids, static_cast<int>(sequence)), mode));
    return answer;
  }
  template <typename Body>
  Answer tell(Body body) {
    return harness.ask(ServiceHarness::in_session(std::move(body), ++sequence));
  }
  ServiceHarness harness;
  std::vector<std::uint64_t> ids;
  std::uint64_t sequence = 0;
};

TEST(ServiceSleep, SleepersAreCountedAndAreNoRemark) {
  Host host(sleepy_scene());
  for (int n = 0; n < 60; ++n) host.step();
  const Answer answer = host.step();
  const auto outcome = answer.reply.batch.u8(Field::kOutcome);
  const auto asleep = std::ranges::count(outcome, std::uint8_t{wire::kAsleep});
  EXPECT_EQ(asleep, std::ranges::count_if(host.ids, [](std::uint64_t id) { return id % 4 != 0; }));
  EXPECT_EQ(
      std::get<wire::Upscale>(answer.reply.body).flagged_nodes,
      static_cast<std::uint64_t>(std::ranges::count_if(outcome, [](auto o) { return (o & ~wire::kAsleep) != 0; })));
  const Answer closed = host.tell(wire::CloseSession{});
  const auto totals = std::get<wire::SessionClosed>(closed.reply.body);
  EXPECT_GT(totals.asleep_node_steps, 20U * static_cast<std::uint64_t>(asleep));
}

// A trial that is rolled back must change neither the set of sleeping nodes nor the time at which a node falls asleep.
TEST(ServiceSleep, ATrialThatIsRolledBackNeverHappened) {
  Host plain(sleepy_scene()), tried(sleepy_scene());
  for (int n = 0; n < 70; ++n) {
    if (n % 3 == 0) {
      wire::Batch other = columns(tried.ids, 0);  // a step in which all nodes slide, so that sleepers wake
      tried.harness.ask(ServiceHarness::step(++tried.sequence, std::move(other), Mode::kTrial));
      tried.tell(wire::Rollback{});
    }
    const Answer expected = plain.harness.ask(ServiceHarness::step(++plain.sequence, columns(plain.ids, n)));
    const Answer found = tried.harness.ask(ServiceHarness::step(++tried.sequence, columns(tried.ids, n)));
    ASSERT_EQ(found.payload(), expected.payload()) << "step " << n;
  }
}

// After a rollback to a mark the same nodes sleep as when the mark was set, and repeated steps give the same bits.
TEST(ServiceSleep, AMarkKeepsSleepers) {
  Host host(sleepy_scene());
  for (int n = 0; n < 40; ++n) host.step();
  host.tell(wire::Mark{.name = "m"});
  const auto run = [&](int steps) {
    std::vector<std::byte> all;
    for (int n = 0; n < steps; ++n) {
      const auto payload =
          host.harness.ask(ServiceHarness::step(++host.sequence, columns(host.ids, n < 3 ? 0 : 9))).payload();
      all.insert(all.end(), payload.begin(), payload.end());
    }
    return all;
  };
  const auto first = run(30);
  ASSERT_EQ(host.tell(wire::Rollback{.to_mark = "m"}).code(), wire::Code::kOk);
  EXPECT_EQ(run(30), first);
}

// The bits of sleeping and waking nodes do not depend on the division into batches, the order of the nodes or the
// number of threads.
TEST(ServiceSleep, BatchesAndThreadsCannotBeTold) {
  Host whole(sleepy_scene());
  ServiceHarness cut(2, {.nodes_per_task = 1});
  cut.ask(ServiceHarness::opening(sleepy_scene(), whole.ids));
  std::uint64_t sequence = 0;
  for (int n = 0; n < 50; ++n) {
    const Answer expected = whole.harness.ask(ServiceHarness::step(++whole.sequence, columns(whole.ids, n)));
    for (const std::size_t part : {1U, 0U}) {
      std::vector<std::uint64_t> ids;
      for (std::size_t i = whole.ids.size(); i-- > 0;)
        if (whole.ids[i] % 2 == part) ids.push_back(whole.ids[i]);
      const Answer found = cut.ask(ServiceHarness::step(++sequence, columns(ids, n, true)));
      for (std::size_t row = 0; row < ids.size(); ++row) {
        const std::size_t at = ids[row] - whole.ids.front();
        for (const Field field : {Field::kInterfaceTemperature, Field::kShearStress, Field::kVelocityJumpNew})
          ASSERT_EQ(found.reply.batch.f64(field)[row], expected.reply.batch.f64(field)[at]) << "step " << n;
        ASSERT_EQ(found.reply.batch.u8(Field::kOutcome)[row], expected.reply.batch.u8(Field::kOutcome)[at]);
      }
    }
  }
}

// A node that moves to another session, asleep or awake, gives the same bits as a node that stays.
TEST(ServiceSleep, SleepersMoveWithTheirBits) {
  Host stayed(sleepy_scene());
  ServiceHarness moved;
  const auto open = [&](std::uint8_t session, const std::vector<std::uint64_t>& ids) {
    wire::Request request = ServiceHarness::opening(sleepy_scene(), ids, session);
    std::get<wire::OpenSession>(request.body).domain = "d";
    moved.granted(request);
  };
  std::vector<std::uint64_t> here = stayed.ids, there = {7};
  open(1, here);
  open(2, there);
  std::uint64_t sequence[] = {0, 0};
  for (int n = 0; n < 70; ++n) {
    if (n == 35) {
      std::vector<std::uint64_t> going, staying;
      for (const std::uint64_t id : here) (id % 3 == 0 ? going : staying).push_back(id);
      wire::TransferId transfer{};
      transfer.fill(9);
      const auto offer = ServiceHarness::of_nodes(wire::OfferNodes{transfer}, going, ++sequence[0]);
      moved.granted(offer);
      moved.granted(ServiceHarness::in_session(wire::AcceptNodes{transfer}, ++sequence[1], 2));
      here = staying;
      there.insert(there.end(), going.begin(), going.end());
    }
    const int phase = n < 60 ? n : 0;  // from step 60 all nodes slide again
    ++stayed.sequence;
    const Answer expected = stayed.harness.ask(ServiceHarness::step(stayed.sequence, columns(stayed.ids, phase)));
    for (const std::uint8_t session : {std::uint8_t{1}, std::uint8_t{2}}) {
      const auto& ids = session == 1 ? here : there;
      const Answer found =
          moved.ask(ServiceHarness::step(++sequence[session - 1], columns(ids, phase), Mode::kAdvance, session));
      for (std::size_t row = 0; row < ids.size(); ++row) {
        if (ids[row] < stayed.ids.front()) continue;
        const std::size_t at = ids[row] - stayed.ids.front();
        ASSERT_EQ(found.reply.batch.f64(Field::kInterfaceTemperature)[row],
                  expected.reply.batch.f64(Field::kInterfaceTemperature)[at])
            << "step " << n << ", node " << ids[row];
        ASSERT_EQ(found.reply.batch.u8(Field::kOutcome)[row], expected.reply.batch.u8(Field::kOutcome)[at]);
      }
    }
  }
}

}  // namespace
}  // namespace shearbus::service
