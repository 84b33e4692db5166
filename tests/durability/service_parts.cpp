// Servers that die between the parts of a step, with a store in memory and no sockets. The answers must have the bits
// of a server that never dies.
#include <gtest/gtest.h>

#include <vector>

#include "tests/support/durable_server.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::service {
namespace {

constexpr std::size_t kNodes = 21;
constexpr std::uint32_t kParts = 3;

// Steps of three parts; every fourth is a trial that is then committed or rolled back. Some nodes are never named.
wire::Request request_at(Strategy strategy, std::uint64_t sequence) {
  const std::uint64_t step = (sequence - 1) / (kParts + 1), place = (sequence - 1) % (kParts + 1);
  const auto ids = support::node_ids(kNodes);
  const bool trial = step % 2 == 0;
  if (place == kParts) {
    if (trial && step % 4 == 0) return ServiceHarness::in_session(wire::Commit{}, sequence);
    return ServiceHarness::in_session(wire::Rollback{}, sequence);
  }
  wire::Request request = ServiceHarness::step(
      sequence, support::step_columns(strategy, std::span(ids).subspan(6 * place, 6), static_cast<int>(step), true),
      trial ? wire::Mode::kTrial : wire::Mode::kAdvance);
  auto& body = std::get<wire::Downscale>(request.body);
  body.part = static_cast<std::uint32_t>(place + 1);
  body.parts = kParts;
  body.absent_nodes = step % 3 == 0 ? wire::AbsentNodes::kOpen : wire::AbsentNodes::kKeep;
  return request;
}

bool is_later_part(const wire::Request& request) {
  const auto* step = std::get_if<wire::Downscale>(&request.body);
  return step != nullptr && step->part > 1;
}

class PartsOfAStep : public testing::TestWithParam<Strategy> {};
INSTANTIATE_TEST_SUITE_P(Strategies, PartsOfAStep, support::both<Strategy>(), support::name_of_strategy);

// The server dies after every request, with and without checkpoints. Each later part follows the one before, as if it had
// been sent before that was answered: a server that comes back must answer both again.
TEST_P(PartsOfAStep, SurviveTheDeathOfTheServerBetweenAnyTwo) {
  constexpr std::uint64_t kRequests = 36;
  const wire::Request opening = ServiceHarness::opening(support::scene_of(GetParam()), support::node_ids(kNodes));
  for (const std::uint64_t checkpoint_every : {1000, 1, 2, 3}) {
    MemoryStorage disk, calm_disk;
    ASSERT_EQ(DurableServer(disk).ask(opening).code(), Code::kOk);
    DurableServer reference(calm_disk);
    ASSERT_EQ(reference.ask(opening).code(), Code::kOk);
    wire::Request before;
    std::vector<std::byte> answer_before;
    for (std::uint64_t i = 1; i <= kRequests; ++i) {
      wire::Request request = request_at(GetParam(), i);
      const bool later = is_later_part(request);
      const Answer expected = reference.ask(request);
      if (later) request = ServiceHarness::ahead(std::move(request), before);
      {
        DurableServer server(disk, store::Durability::kProcess, 77 + 2 * i, 1 + static_cast<unsigned>(i % 3));
        if (later) {
          EXPECT_EQ(server.ask(ServiceHarness::in_session(wire::Commit{}, i)).code(), Code::kNothingToCommit);
        }
        const Answer answer = server.ask(request);
        ASSERT_EQ(answer.code(), Code::kOk) << "request " << i << ": " << describe(answer.reply.status);
        ASSERT_EQ(answer.payload(), expected.payload()) << "request " << i;
        if (i % checkpoint_every == 0) {
          ASSERT_TRUE(server.service.checkpoint()) << "request " << i;
        }
      }
      DurableServer server(disk, store::Durability::kProcess, 78 + 2 * i);
      const Answer again = server.ask(request);
      ASSERT_TRUE(again.reply.replayed);
      ASSERT_EQ(again.payload(), expected.payload());
      if (later) {
        const Answer first = server.ask(before);
        ASSERT_EQ(first.code(), Code::kOk) << "before request " << i << ": " << describe(first.reply.status);
        ASSERT_TRUE(first.reply.replayed);
        ASSERT_EQ(first.payload(), answer_before);
      } else if (i > 1) {
        ASSERT_EQ(server.ask(before).code(), Code::kStaleSequence);
      }
      answer_before = expected.payload();
      before = std::move(request);
    }
  }
}

}  // namespace
}  // namespace shearbus::service
