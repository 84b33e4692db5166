// Closed sessions are remembered (P2): a repeated close_session is answered, and a late copy of an opening opens
// nothing, however many sessions others close meanwhile, and after a restart.
#include <gtest/gtest.h>

#include "tests/support/durable_server.hpp"

namespace shearbus::service {
namespace {

wire::SessionId id_of(int number) {
  wire::SessionId id{};
  id[0] = static_cast<std::uint8_t>(number & 255);
  id[1] = static_cast<std::uint8_t>(number >> 8);
  id[15] = 1;
  return id;
}

wire::Request opening_of(int number) {
  wire::Request opening = ServiceHarness::opening(support::force_scene(4), support::node_ids(1));
  std::get<wire::OpenSession>(opening.body).session_id = id_of(number);
  return opening;
}

wire::Request closing_of(int number) {
  wire::Request closing = ServiceHarness::in_session(wire::CloseSession{.reason = "done"}, 1);
  closing.session_id = id_of(number);
  return closing;
}

class Goodbyes : public testing::TestWithParam<bool> {};

TEST_P(Goodbyes, AreAnsweredAgainAfterHundredsOfOthersAndARestart) {
  constexpr int kOthers = 300;
  const Caller alice{.identity = "uid 1001"}, bob{.identity = "uid 1002"};
  MemoryStorage disk;
  Answer first;
  {
    DurableServer server(disk);
    ASSERT_EQ(server.ask(opening_of(0), alice).code(), Code::kOk);
    ASSERT_EQ(server.ask(closing_of(0), alice).code(), Code::kOk);
    first = server.ask(closing_of(0), alice);
    for (int other = 1; other <= kOthers; ++other) {
      const Caller& caller = other % 2 == 0 ? alice : bob;
      ASSERT_EQ(server.ask(opening_of(other), caller).code(), Code::kOk);
      ASSERT_EQ(server.ask(closing_of(other), caller).code(), Code::kOk);
    }
    if (GetParam()) {
      ASSERT_TRUE(server.service.checkpoint());
    }
  }
  for (int start = 0; start < 2; ++start) {
    DurableServer server(disk, store::Durability::kProcess, 78 + static_cast<std::uint64_t>(start));
    for (const int number : {0, 1, 2, kOthers}) {
      const Caller& caller = number % 2 == 0 ? alice : bob;
      const Answer again = server.ask(closing_of(number), caller);
      EXPECT_TRUE(again.reply.status.ok()) << number << ": " << describe(again.reply.status);
      EXPECT_TRUE(again.reply.replayed);
      EXPECT_EQ(server.ask(opening_of(number), caller).code(), Code::kStaleSequence) << number;
    }
    EXPECT_EQ(server.ask(closing_of(0), alice).frames.header, first.frames.header) << "byte for byte";
    EXPECT_EQ(server.service.status().sessions, 0u);
    EXPECT_EQ(server.service.status().state_bytes, 0u);
    ASSERT_TRUE(server.service.checkpoint());
  }
}

INSTANTIATE_TEST_SUITE_P(, Goodbyes, testing::Bool(),
                         [](const auto& with) { return with.param ? "WithACheckpoint" : "FromTheJournal"; });

}  // namespace
}  // namespace shearbus::service
