#include <gtest/gtest.h>

#include <memory>

#include "server/session/session.hpp"

namespace shearbus::session {
namespace {

constexpr std::uint64_t kHash = 11;
constexpr std::uint64_t kOtherHash = 12;

Session session_at(std::uint64_t sequence) {
  Session session;
  session.complete(sequence, kHash, std::make_shared<wire::Reply>());
  return session;
}

TEST(Session, StartsWithItsOpening) {
  const Session session;
  EXPECT_EQ(session.triage(0, kHash).triage, Triage::kProcess);
  EXPECT_EQ(session.triage(1, kHash).status.code, wire::Code::kSequenceGap);
}

TEST(Session, NextSequenceIsProcessed) {
  EXPECT_EQ(session_at(0).triage(1, kOtherHash).triage, Triage::kProcess);
  EXPECT_EQ(session_at(41).triage(42, kOtherHash).triage, Triage::kProcess);
}

TEST(Session, SameBytesAgainAreAnsweredFromMemory) {
  const Session session = session_at(5);
  EXPECT_EQ(session.triage(5, kHash).triage, Triage::kResend);
  EXPECT_NE(session.kept_reply(), nullptr);
}

TEST(Session, SameSequenceWithOtherBytesIsRefused) {
  const Verdict verdict = session_at(5).triage(5, kOtherHash);
  EXPECT_EQ(verdict.triage, Triage::kReject);
  EXPECT_EQ(verdict.status.code, wire::Code::kSequenceReused);
  EXPECT_EQ(verdict.status.last_sequence, 5u);
}

TEST(Session, OldSequenceIsStaleEvenWithTheSameBytes) {
  const Verdict verdict = session_at(5).triage(4, kHash);
  EXPECT_EQ(verdict.status.code, wire::Code::kStaleSequence);
  EXPECT_EQ(verdict.status.last_sequence, 5u);
}

TEST(Session, GapIsRefusedAndNamesWhereTheSessionStands) {
  const Verdict verdict = session_at(5).triage(7, kOtherHash);
  EXPECT_EQ(verdict.status.code, wire::Code::kSequenceGap);
  EXPECT_EQ(verdict.status.last_sequence, 5u);
}

TEST(Session, ARefusedRequestLeavesItsSequenceFree) {
  Session session = session_at(5);
  // the request is triaged but not executed: complete() is not called
  static_cast<void>(session.triage(6, kOtherHash));
  EXPECT_EQ(session.triage(6, kHash).triage, Triage::kProcess);
  EXPECT_EQ(session.triage(5, kHash).triage, Triage::kResend);
}

TEST(Session, BehindAPartTheReplyToTheOneBeforeIsKeptUntilTheNextStepBegins) {
  const auto first = std::make_shared<wire::Reply>(), second = std::make_shared<wire::Reply>();
  const auto ahead = [&] {
    Session session = session_at(4);
    session.complete(5, 50, first);
    EXPECT_EQ(session.complete(6, 60, second, true), nullptr) << "both replies are kept";
    return session;
  };
  Session session = ahead();
  EXPECT_EQ(session.triage(5, 50).reply, first);
  EXPECT_EQ(session.triage(6, 60).reply, second);
  EXPECT_EQ(session.triage(5, 60).status.code, wire::Code::kSequenceReused);
  EXPECT_EQ(session.triage(6, 50).status.code, wire::Code::kSequenceReused);
  EXPECT_EQ(session.triage(4, kHash).status.code, wire::Code::kStaleSequence);
  EXPECT_EQ(session.triage(7, 70).triage, Triage::kProcess);
  EXPECT_EQ(session.forget_before(), first);
  EXPECT_EQ(session.triage(5, 50).status.code, wire::Code::kStaleSequence);
  EXPECT_EQ(session.triage(6, 60).reply, second);
  session.complete(7, 70, std::make_shared<wire::Reply>(), true);
  EXPECT_EQ(session.triage(6, 60).reply, second);

  session = ahead();
  EXPECT_EQ(session.complete(7, 70, std::make_shared<wire::Reply>()), second) << "an ordinary request ends both";
  EXPECT_EQ(session.triage(6, 60).status.code, wire::Code::kStaleSequence);
  EXPECT_EQ(session.triage(5, 50).status.code, wire::Code::kStaleSequence);
}

TEST(Session, LargestSequenceDoesNotWrapAround) {
  const Session session = session_at(~std::uint64_t{0});
  EXPECT_EQ(session.triage(0, kOtherHash).triage, Triage::kReject);
}

}  // namespace
}  // namespace shearbus::session
