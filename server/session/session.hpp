// The memory of one session's conversation: which request comes next, and the reply to the last one. It decides whether
// a request is run, answered again from memory, or refused; it knows nothing of what requests do.
//
// A client has one request in flight. It numbers them 1, 2, 3, ... (0 is the opening) and repeats one, byte for byte,
// until it has the answer. So one kept reply is enough for every request to run at most once, however often it arrives:
//
//   sequence == last + 1              process
//   sequence == last, same bytes      resend the kept reply
//   sequence == last, other bytes     reject, SEQUENCE_REUSED
//   sequence <  last                  reject, STALE_SEQUENCE
//   sequence >  last + 1              reject, SEQUENCE_GAP
//
// A refused request does not count: its sequence is free for the corrected one.
#pragma once

#include <cstdint>
#include <memory>

#include "proto/wire/messages.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::session {

enum class Triage { kProcess, kResend, kReject };

struct Verdict {
  Triage triage = Triage::kProcess;
  wire::Status status;  // of kReject
};

class Session {
 public:
  Verdict triage(std::uint64_t sequence, std::uint64_t hash) const;

  // Called when a request has changed the state: from here on its repetition is answered with `reply`.
  void complete(std::uint64_t sequence, std::uint64_t hash, std::shared_ptr<wire::Reply> reply);

  std::uint64_t last_sequence() const { return last_sequence_; }
  std::uint64_t last_hash() const { return last_hash_; }
  const std::shared_ptr<wire::Reply>& kept_reply() const { return kept_reply_; }

 private:
  std::uint64_t last_sequence_ = 0;
  std::uint64_t last_hash_ = 0;
  std::shared_ptr<wire::Reply> kept_reply_;  // null until the session is open
};

}  // namespace shearbus::session
