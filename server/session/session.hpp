// The request history of one session: the next sequence number and the reply to the last request. It decides whether a
// request is executed, answered with the kept reply, or refused. It does not interpret requests.
//
// A client waits for the reply to a request before it sends the next one. It numbers its requests 1, 2, 3, ... (0 opens
// the session) and repeats a request, byte for byte, until it has the answer. One kept reply therefore suffices to
// execute each request at most once:
//
//   sequence == last + 1              process
//   sequence == last, same bytes      resend the kept reply
//   sequence == last, other bytes     reject, SEQUENCE_REUSED
//   sequence <  last                  reject, STALE_SEQUENCE
//   sequence >  last + 1              reject, SEQUENCE_GAP
//
// A refused request does not use up its sequence number: the corrected request has the same number.
#pragma once

#include <cstdint>
#include <memory>

#include "proto/wire/messages.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::session {

enum class Triage { kProcess, kResend, kReject };

struct Verdict {
  Triage triage = Triage::kProcess;
  wire::Status status;  // why the request is rejected; set for kReject only
};

class Session {
 public:
  Verdict triage(std::uint64_t sequence, std::uint64_t hash) const;

  // Must be called when a request has changed the state; repetitions of the request are then answered with `reply`.
  // Returns the reply to the request before, which the session no longer needs.
  std::shared_ptr<wire::Reply> complete(std::uint64_t sequence, std::uint64_t hash, std::shared_ptr<wire::Reply> reply);

  std::uint64_t last_sequence() const { return last_sequence_; }
  std::uint64_t last_hash() const { return last_hash_; }
  const std::shared_ptr<wire::Reply>& kept_reply() const { return kept_reply_; }

 private:
  std::uint64_t last_sequence_ = 0;
  std::uint64_t last_hash_ = 0;
  std::shared_ptr<wire::Reply> kept_reply_;  // reply to the last request; null until the session is open
};

}  // namespace shearbus::session
