// A session belongs to the key or the user that opened it, also after a restart of the server. The id and the token of
// the session alone give no access.
#include <gtest/gtest.h>

#include "tests/support/durable_server.hpp"

namespace shearbus::service {
namespace {

const std::vector<std::uint64_t> kNodes = support::node_ids(5);
const service::Caller kOwner{.identity = "key owner"};
const service::Caller kThief{.identity = "key thief"};
const service::Caller kOperator{.identity = "uid 7", .is_operator = true};

wire::ResumeToken token() {
  wire::ResumeToken token;
  token.fill(9);
  return token;
}

wire::Request opening() {
  wire::Request request = ServiceHarness::opening(support::force_scene(), kNodes);
  std::get<wire::OpenSession>(request.body).resume_token = token();
  return request;
}

wire::Request resume() {
  return ServiceHarness::in_session(wire::ResumeSession{.resume_token = token()}, 0);
}

wire::Request step(std::uint64_t sequence) {
  return ServiceHarness::step(sequence, support::step_columns(wire::Strategy::kForceDriven, kNodes, 1));
}

// A caller knows the id and the token of the session and all its frames, but does not have its key. Requires that the
// server refuses this caller, and that no request of the caller changes or reveals anything.
void expect_refused(DurableServer& server, const service::Caller& caller, std::uint64_t next) {
  for (const wire::Request& request :
       {opening(), resume(), step(next), step(next - 1), ServiceHarness::in_session(wire::CloseSession{}, next)}) {
    const auto answer = server.ask(request, caller);
    EXPECT_EQ(answer.code(), Code::kNotPermitted) << describe(answer.reply.status);
    EXPECT_EQ(answer.reply.status.text.find("owner"), std::string::npos) << "it tells whose the session is";
    EXPECT_EQ(answer.reply.status.last_sequence, 0u);
    EXPECT_FALSE(answer.frames.has_payload);
  }
}

TEST(SessionIdentity, AStolenTokenIsOfNoUseToAnother) {
  support::MemoryStorage disk;
  DurableServer server(disk);
  ASSERT_TRUE(server.ask(opening(), kOwner).reply.status.ok());
  ASSERT_TRUE(server.ask(step(1), kOwner).reply.status.ok());
  expect_refused(server, kThief, 2);
  expect_refused(server, {}, 2);
  EXPECT_TRUE(server.ask(resume(), kOwner).reply.status.ok());
  EXPECT_TRUE(server.ask(step(2), kOwner).reply.status.ok());
  EXPECT_TRUE(server.ask(resume(), kOperator).reply.status.ok());
}

TEST(SessionIdentity, TheNextServerKnowsTheOwnerFromTheJournalOrTheCheckpoint) {
  for (const int checkpoints : {0, 2}) {
    support::MemoryStorage disk;
    {
      DurableServer server(disk);
      ASSERT_TRUE(server.ask(opening(), kOwner).reply.status.ok());
      ASSERT_TRUE(server.ask(step(1), kOwner).reply.status.ok());
      for (int i = 0; i < checkpoints; ++i) ASSERT_TRUE(server.service.checkpoint());
    }
    DurableServer next(disk, store::Durability::kProcess, 78);
    EXPECT_EQ(next.store.counters().replayed == 0, checkpoints > 0);
    expect_refused(next, kThief, 2);
    EXPECT_TRUE(next.ask(step(2), kOwner).reply.status.ok());
  }
}

TEST(SessionIdentity, TheWelcomeTellsHowTheClientIsKnown) {
  ServiceHarness harness;
  wire::Request hello;
  hello.body = wire::Hello{};
  const auto welcome_for = [&](const service::Caller& caller) {
    return std::get<wire::Welcome>(harness.ask(hello, caller).reply.body);
  };
  EXPECT_EQ(welcome_for(kOwner).access, "key");
  EXPECT_EQ(welcome_for(kOperator).access, "uid");
  EXPECT_EQ(welcome_for({.identity = "anonymous"}).access, "anonymous");
  const auto has = [](const wire::Welcome& welcome, const char* word) {
    return std::ranges::count(welcome.capabilities, word) == 1;
  };
  EXPECT_TRUE(has(welcome_for(kOperator), "operator"));
  EXPECT_FALSE(has(welcome_for(kOwner), "operator"));
  EXPECT_EQ(welcome_for(kOwner).limits.max_frames, 2u);
  EXPECT_EQ(welcome_for(kOwner).limits.max_state_bytes, std::uint64_t{8} << 30);
}

}  // namespace
}  // namespace shearbus::service
