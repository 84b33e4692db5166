#include <gtest/gtest.h>

#include <memory>
#include <string>

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

TEST(Session, RunsTheNextSequenceAnswersTheLastAgainAndRefusesAllOthers) {
  constexpr std::uint64_t kLast = ~std::uint64_t{0};
  using wire::Code;
  struct Case {
    std::uint64_t at, sequence, hash;
    Triage triage;
    Code code = Code::kOk;
  };
  for (const auto& [at, sequence, hash, triage, code] :
       {Case{0, 1, kOtherHash, Triage::kProcess}, Case{41, 42, kOtherHash, Triage::kProcess},
        Case{5, 5, kHash, Triage::kResend}, Case{5, 5, kOtherHash, Triage::kReject, Code::kSequenceReused},
        Case{5, 4, kHash, Triage::kReject, Code::kStaleSequence},
        Case{5, 7, kOtherHash, Triage::kReject, Code::kSequenceGap},
        Case{kLast, 0, kOtherHash, Triage::kReject, Code::kStaleSequence}}) {  // it does not wrap around
    SCOPED_TRACE("sequence " + std::to_string(sequence) + " after " + std::to_string(at));
    const Session session = session_at(at);
    const Verdict verdict = session.triage(sequence, hash);
    EXPECT_EQ(verdict.triage, triage);
    EXPECT_EQ(verdict.status.code, code);
    EXPECT_EQ(verdict.reply != nullptr, triage == Triage::kResend);
    if (triage == Triage::kReject) {
      EXPECT_EQ(verdict.status.last_sequence, at);
    }
  }
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

}  // namespace
}  // namespace shearbus::session
