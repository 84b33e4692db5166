// The request history of one session: the next sequence number and the reply to the last request. It decides whether a
// request is executed, answered with a kept reply, or refused. It does not interpret requests.
//
// A client waits for the reply to a request before it sends the next one. It numbers its requests 1, 2, 3, ... (0 opens
// the session) and repeats a request, byte for byte, until it has the answer. One kept reply therefore suffices to
// execute each request at most once. A part of a step that was sent before the part before it was answered needs two,
// because the client may lack the answers to both.
//
//   sequence == last + 1                    process
//   sequence == last, same bytes            resend the kept reply
//   sequence == last, other bytes           reject, SEQUENCE_REUSED
//   sequence == last - 1, reply is kept     as for last
//   sequence <  last                        reject, STALE_SEQUENCE
//   sequence >  last + 1                    reject, SEQUENCE_GAP
//
// A refused request does not use up its sequence number: the corrected request has the same number.
#pragma once

#include <cstdint>
#include <memory>
#include <utility>

#include "proto/wire/messages.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::session {

enum class Triage { kProcess, kResend, kReject };

struct Verdict {
  Triage triage = Triage::kProcess;
  wire::Status status;                 // why the request is rejected; set for kReject only
  std::shared_ptr<wire::Reply> reply;  // reply to resend; set for kResend only
};

// A request that has run, and the reply to it.
struct Kept {
  std::uint64_t sequence = 0;
  std::uint64_t hash = 0;  // of the request's header frame
  std::shared_ptr<wire::Reply> reply;
};

class Session {
 public:
  Verdict triage(std::uint64_t sequence, std::uint64_t hash) const;

  // Must be called when a request has changed the state; repetitions of the request are then answered with `reply`.
  // `follows`: the request was sent before the one before it was answered, so that the session keeps the reply to that
  // one, too, until forget_before() or until another request completes. Returns a reply that the session no longer needs; may be null.
  std::shared_ptr<wire::Reply> complete(std::uint64_t sequence, std::uint64_t hash, std::shared_ptr<wire::Reply> reply,
                                        bool follows = false);

  // Gives up the reply to the request before the last one. To be called when the next step begins: its client has sent
  // it only after that reply came. Returns the reply; may be null.
  std::shared_ptr<wire::Reply> forget_before() { return std::exchange(before_, {}).reply; }

  std::uint64_t last_sequence() const { return last_.sequence; }
  std::uint64_t last_hash() const { return last_.hash; }
  const std::shared_ptr<wire::Reply>& kept_reply() const { return last_.reply; }
  const Kept& before() const { return before_; }

 private:
  Kept last_;    // the last request; without a reply until the session is open
  Kept before_;  // the request before it, while its reply is kept; without a reply otherwise
};

}  // namespace shearbus::session
