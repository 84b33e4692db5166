#include "server/session/session.hpp"

#include <string>
#include <utility>

namespace shearbus::session {

Verdict Session::triage(std::uint64_t sequence, std::uint64_t hash) const {
  const auto reject = [&](wire::Code code, std::string text, std::string remedy) {
    return Verdict{
        Triage::kReject,
        {.code = code, .text = std::move(text), .remedy = std::move(remedy), .last_sequence = last_.sequence},
        nullptr};
  };
  const bool open = last_.reply != nullptr;
  const bool is_next = open ? sequence > last_.sequence && sequence - last_.sequence == 1 : sequence == 0;
  if (is_next) return {};
  const std::string found = "sequence " + std::to_string(sequence);
  const std::string last = std::to_string(last_.sequence);
  if (!open || sequence > last_.sequence)
    return reject(wire::Code::kSequenceGap, found + " after " + last + ": requests in between are missing",
                  "Number requests 1, 2, 3, ... and wait for each reply.");
  const bool is_before = before_.reply != nullptr && sequence == before_.sequence;
  if (sequence < last_.sequence && !is_before)
    return reject(wire::Code::kStaleSequence, found + " is over: the session is at " + last,
                  "Only the last request may be repeated.");
  const Kept& kept = is_before ? before_ : last_;
  if (hash != kept.hash)
    return reject(wire::Code::kSequenceReused, found + " was used by a request with other bytes",
                  "Repeat a request byte for byte, or use the next sequence.");
  return {Triage::kResend, {}, kept.reply};
}

std::shared_ptr<wire::Reply> Session::complete(std::uint64_t sequence, std::uint64_t hash,
                                               std::shared_ptr<wire::Reply> reply, bool follows) {
  Kept spent = std::exchange(last_, {.sequence = sequence, .hash = hash, .reply = std::move(reply)});
  if (follows)
    std::swap(spent, before_);
  else
    before_ = {};
  return std::move(spent.reply);
}

}  // namespace shearbus::session
