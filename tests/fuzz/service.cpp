// Fuzzes a service with a sequence of requests, on a disk, with restarts in between. A twin service, which never
// restarts, receives each accepted request once. Whatever the requests are, three properties must hold:
//   P1  after a restart the server repeats the last answer of every session on request
//   P2  a repeated request gets the same answer and does not run again
//   P3  a refused request changes nothing: the twin service never receives it, and still gives the same answers
//
// The input consists of parts, in turn the header and the payload of a request. As a client would do, the target fills
// in fields that a header leaves at 0 or empty (magic, version, session, sequence, size and checksum of the payload).
// So an early mutation does not turn all later requests into refusals. A header of one byte is no request but an event:
// a checkpoint or a restart.
#include <google/protobuf/stubs/logging.h>

#include <cmath>
#include <map>
#include <memory>
#include <optional>

#include "shearbus/v1/envelope.pb.h"
#include "tests/fuzz/mutate.hpp"
#include "tests/fuzz/pairs_sample.hpp"
#include "tests/fuzz/script.hpp"
#include "tests/fuzz/target.hpp"
#include "tests/support/durable_server.hpp"
#include "tests/support/memory_storage.hpp"

namespace shearbus::fuzz {
namespace {

constexpr std::size_t kMostRequests = 24;
constexpr std::uint64_t kMemory = std::uint64_t{1} << 20;

class Conversation {
 public:
  Conversation()
      : server_(std::make_unique<support::DurableServer>(disk_, store::Durability::kProcess, epoch_, 1, kMemory)),
        twin_(1, {.max_state_bytes = kMemory}) {}

  void checkpoint() { require(server_->service.checkpoint(), "a checkpoint is written where the disk is sound"); }

  void restart() {
    server_.reset();
    server_ = std::make_unique<support::DurableServer>(disk_, store::Durability::kProcess, ++epoch_, 1, kMemory);
    for (const auto& [id, last] : last_) expect_repeat(last, "P1: after a restart the last answer is given again");
  }

  void ask(Parts frames) {
    std::optional<v1::RequestHeader> header = parsed(frames[0]);
    if (header) complete(*header, frames);
    const support::Answer answer = answered(frames);
    if (answer.code() != wire::Code::kOk || answer.reply.replayed || !header) return;
    if (header->has_hello() || header->has_server_status() || header->has_resume_session()) return;
    check_numbers(answer.reply.batch);
    Last last{.frames = frames, .payload = answer.payload(), .sequence = header->sequence()};
    expect_repeat(last, "P2: a repeated request has the same answer");
    last_.insert_or_assign(answer.reply.session_id, std::move(last));

    header->set_epoch(0);  // the twin service never restarts, so its sessions are never resumed and their epoch stays 0
    frames[0] = header->SerializeAsString();
    const support::Answer alike = twin_.ask_bytes(views_of(frames));
    require(alike.code() == wire::Code::kOk, "P3: the twin accepts what was accepted: " + alike.reply.status.text);
    require(alike.payload() == answer.payload(), "P3: the twin answers alike");
  }

 private:
  struct Last {
    Parts frames;
    std::vector<std::byte> payload;
    std::uint64_t sequence = 0;
  };

  support::Answer answered(const Parts& frames) {
    auto answer = server_->try_ask(views_of(frames));
    require(answer.has_value(), "a service whose disk is sound answers");
    require(answer->code() != wire::Code::kInternal, "no request is an internal error: " + answer->reply.status.text);
    require(answer->code() == wire::Code::kOk || !answer->reply.status.text.empty(), "a refusal says why");
    return std::move(*answer);
  }

  void expect_repeat(const Last& last, const char* law) {
    const support::Answer again = answered(last.frames);
    require(again.code() == wire::Code::kOk && again.reply.replayed && again.payload() == last.payload,
            law + (": " + again.reply.status.text));
  }

  static std::optional<v1::RequestHeader> parsed(const std::string& frame) {
    v1::RequestHeader header;
    const google::protobuf::LogSilencer quiet;
    if (!header.ParseFromString(frame)) return std::nullopt;
    return header;
  }

  void complete(v1::RequestHeader& header, Parts& frames) const {
    if (header.magic() == 0) header.set_magic(wire::kMagic);
    if (header.protocol_major() == 0) header.set_protocol_major(wire::kProtocolMajor);
    const bool in_session = !header.has_hello() && !header.has_server_status() && !header.has_open_session();
    if (in_session && header.session_id().empty()) {
      const auto id = support::ServiceHarness::id(header.request_id() % 2 == 0 ? 2 : 1);
      header.set_session_id(id.data(), id.size());
    }
    if (in_session && header.sequence() == 0 && header.session_id().size() == wire::kSessionIdBytes) {
      wire::SessionId id{};
      std::copy(header.session_id().begin(), header.session_id().end(), id.begin());
      const auto last = last_.find(id);
      header.set_sequence(last == last_.end() ? 1 : last->second.sequence + 1);
    }
    frames[0] = header.SerializeAsString();
    if (frames.size() > 1 && header.has_payload() && header.payload().xxh3() == 0)
      mend_payload(frames[0], frames[1], false);
    header = *parsed(frames[0]);
  }

  static void check_numbers(const wire::Batch& batch) {
    for (const wire::Column& column : batch.columns())
      for (const double value : batch.f64(column.field, column.component))
        require(std::isfinite(value), std::string(wire::name(column.field)) + " is a number");
  }

  std::uint64_t epoch_ = 77;
  support::MemoryStorage disk_;
  std::unique_ptr<support::DurableServer> server_;
  support::ServiceHarness twin_;
  std::map<wire::SessionId, Last> last_;
};

// Changes the names of pairs or the keys of parameters in a request to others that a scene of pairs has.
void mutate_names(std::string& frame, Random& random) {
  v1::RequestHeader header;
  const google::protobuf::LogSilencer quiet;
  if (!header.ParsePartialFromString(frame)) return;
  auto* names = header.has_register_nodes() ? header.mutable_register_nodes()->mutable_pairs() : nullptr;
  std::vector<std::string> known = kPairNames;
  if (header.has_open_session() && random.one_in(2)) {
    names = header.mutable_open_session()->mutable_parameters();
    known = kParameterKeys;
    known.insert(known.end(), {"layer.thickness_m", "interface.friction_coefficient", "hard.density_kg_per_m3"});
  } else if (header.has_open_session()) {
    names = header.mutable_open_session()->mutable_pairs();
  }
  if (names == nullptr) return;
  if (const std::string& name = known[random.below(known.size())]; names->empty() || random.one_in(3))
    *names->Add() = name;
  else
    *names->Mutable(static_cast<int>(random.below(static_cast<std::size_t>(names->size())))) = name;
  frame = header.SerializeAsString();
}

}  // namespace
}  // namespace shearbus::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace shearbus::fuzz;
  const Parts parts = unpack(data, size);
  Conversation conversation;
  for (std::size_t i = 0; i < parts.size() && i < 2 * kMostRequests; i += 2) {
    const std::string& header = parts[i];
    if (header == kCheckpointEvent)
      conversation.checkpoint();
    else if (header == kRestartEvent)
      conversation.restart();
    else if (i + 1 < parts.size() && !parts[i + 1].empty())
      conversation.ask({header, parts[i + 1]});
    else
      conversation.ask({header});
  }
  conversation.restart();
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned int seed) {
  using namespace shearbus::fuzz;
  Random random(seed);
  Parts parts = unpack(data, size);
  if (parts.size() % 2 != 0) parts.emplace_back();
  if (parts.empty()) return LLVMFuzzerMutate(data, size, max_size);
  const std::size_t at = 2 * random.below(parts.size() / 2);
  const auto place = parts.begin() + static_cast<std::ptrdiff_t>(at);
  switch (random.below(14)) {
    case 0:
      mutate_bytes(parts[at], parts[at].size() + 32);
      break;
    case 1:
      mutate_bytes(parts[at + 1], parts[at + 1].size() + 32);
      break;
    case 2:
    case 3:
      mutate_reals(parts[at + 1], random);
      break;
    case 4: {  // inserts a copy of one request at a random place in the sequence
      const Parts pair(place, place + 2);
      parts.insert(parts.begin() + static_cast<std::ptrdiff_t>(2 * random.below(parts.size() / 2 + 1)), pair.begin(),
                   pair.end());
      break;
    }
    case 5:
      if (parts.size() > 2) parts.erase(place, place + 2);
      break;
    case 6:
      parts.insert(place, {random.one_in(2) ? kCheckpointEvent : kRestartEvent, ""});
      break;
    case 7:
      mutate_names(parts[at], random);
      break;
    case 8:
      mutate_places(parts[at + 1], random);
      break;
    default:
      mutate_header(parts[at], false, random);
  }
  return give(pack(parts), data, size, max_size);
}

// Combines two inputs: the first requests of one input, followed by the last requests of the other.
extern "C" std::size_t LLVMFuzzerCustomCrossOver(const std::uint8_t* data1, std::size_t size1,
                                                 const std::uint8_t* data2, std::size_t size2, std::uint8_t* out,
                                                 std::size_t max_size, unsigned int seed) {
  using namespace shearbus::fuzz;
  Random random(seed);
  Parts first = unpack(data1, size1);
  const Parts second = unpack(data2, size2);
  first.resize(2 * random.below(first.size() / 2 + 1));
  const std::size_t from = 2 * random.below(second.size() / 2 + 1);
  first.insert(first.end(), second.begin() + static_cast<std::ptrdiff_t>(from), second.end());
  return give(pack(first), out, 0, max_size);
}
