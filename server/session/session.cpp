#include "server/session/session.hpp"

#include <string>
#include <utility>

namespace shearbus::session {

Verdict Session::triage(std::uint64_t sequence, std::uint64_t hash) const {
  const auto reject = [&](wire::Code code, std::string text, std::string remedy) {
    return Verdict{
        Triage::kReject,
        {.code = code, .text = std::move(text), .remedy = std::move(remedy), .last_sequence = last_sequence_}};
  };
  const bool open = kept_reply_ != nullptr;
  const bool is_next = open ? sequence > last_sequence_ && sequence - last_sequence_ == 1 : sequence == 0;
  if (is_next) return {};
  const std::string found = "sequence " + std::to_string(sequence);
  const std::string last = std::to_string(last_sequence_);
  if (!open || sequence > last_sequence_)
    return reject(wire::Code::kSequenceGap, found + " after " + last + ": requests in between are missing",
                  "Number requests 1, 2, 3, ... and wait for each reply.");
  if (sequence < last_sequence_)
    return reject(wire::Code::kStaleSequence, found + " is over: the session is at " + last,
                  "Only the last request may be repeated.");
  if (hash != last_hash_)
    return reject(wire::Code::kSequenceReused, found + " was used by a request with other bytes",
                  "Repeat a request byte for byte, or use the next sequence.");
  return {Triage::kResend, {}};
}

std::shared_ptr<wire::Reply> Session::complete(std::uint64_t sequence, std::uint64_t hash,
                                               std::shared_ptr<wire::Reply> reply) {
  last_sequence_ = sequence;
  last_hash_ = hash;
  return std::exchange(kept_reply_, std::move(reply));
}

}  // namespace shearbus::session
