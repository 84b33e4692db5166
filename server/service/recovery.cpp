// The journal record of a request before it runs, and the recovery of sessions from a checkpoint and the journal.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <string_view>
#include <utility>
#include <variant>

#include "proto/wire/codec.hpp"
#include "server/service/member.hpp"
#include "server/service/scene_model.hpp"
#include "server/service/service.hpp"
#include "server/service/validate.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Error;

namespace {

// A decoded reply, together with the bytes that its columns point into.
struct HeldReply {
  std::vector<std::byte> payload;
  wire::Reply reply;
};

std::shared_ptr<wire::Reply> reply_from(const std::vector<std::byte>& header, const std::vector<std::byte>& payload) {
  auto held = std::make_shared<HeldReply>();
  held->payload = payload;
  wire::decode(wire::frames_of({header, held->payload}), held->reply, wire::PayloadSum::kLeftOut);
  return {held, &held->reply};
}

Parts parts_from(const store::SessionImage& image, const shard::Shard& shard) {
  const std::span<const std::byte> frame = image.part_header;
  wire::Request request;
  wire::decode(std::span(&frame, 1), request);
  Parts parts{.last = std::get<wire::Downscale>(request.body), .stepped = std::vector<bool>(shard.slots())};
  for (const std::uint32_t row : image.part_rows) parts.stepped.at(shard.nodes().slot_of(row)) = true;
  parts.nodes = image.part_rows.size();
  return parts;
}

// A hash of a reply without its times, to compare a replayed reply with the recorded one.
std::uint64_t sum_of(const session::Session& conversation) {
  const wire::Reply& reply = *conversation.kept_reply();
  const auto* step = std::get_if<wire::Upscale>(&reply.body);
  const auto* change = std::get_if<wire::NodesChanged>(&reply.body);
  const std::array<std::uint64_t, 4> numbers = {conversation.last_sequence(), step != nullptr ? step->state_version : 0,
                                                step != nullptr ? step->flagged_nodes : 0,
                                                change != nullptr ? change->nodes : 0};
  const std::array<std::span<const std::byte>, 2> parts = {std::as_bytes(std::span(numbers)), reply.batch.bytes()};
  return wire::hash_of(parts);
}

}  // namespace

void make_repeat(wire::Reply& reply) {
  reply.replayed = true;
  if (auto* step = std::get_if<wire::Upscale>(&reply.body)) step->solver_ns = step->service_ns = 0;
  if (auto* totals = std::get_if<wire::SessionClosed>(&reply.body))
    *totals = {.requests = totals->requests, .node_steps = totals->node_steps};
}

// Writes the request to the journal. After this call the request must run and must not fail, because a recovery replays
// it.
void Service::journal(const Arrival& arrival, const wire::SessionId& session, const Member* member,
                      std::optional<std::uint64_t> sequence) {
  if (store_ == nullptr || replaying_) return;
  try {
    timed(options_.now_ns, times_.journal_append, [&] {
      store_->append({.session = session,
                      .sequence = sequence.value_or(arrival.request.sequence),
                      .previous_reply = member != nullptr ? sum_of(member->conversation) : 0,
                      .header_frame = arrival.frames[0],
                      .payload_frame = arrival.frames.size() > 1 ? arrival.frames[1] : std::span<const std::byte>(),
                      .identity = member != nullptr ? std::string_view() : arrival.caller.identity});
    });
  } catch (const store::StorageError& fault) {
    if (store_->failed()) throw;
    tell_of_journal(fault);
    refuse(Code::kNoSpace, "", fmt::format("the request could not be kept: {}", fault.what()),
           "Nothing was changed. Make room in the server's state directory; the same request again goes on.");
  }
  journal_takes_again();
  journaled_now_ = store_->journaling();
}

// Tells the log once why the journal takes nothing, until it does again.
void Service::tell_of_journal(const std::exception& fault) noexcept try {
  if (journal_fault_ == fault.what()) return;
  const auto* const storage = dynamic_cast<const store::StorageError*>(&fault);
  log(std::string(storage != nullptr && storage->no_space()
                      ? "ALARM: no room in the state directory; requests are refused until there is: "
                      : "ALARM: the journal could not take the sum of a session's last reply: ") +
      fault.what());
  journal_fault_ = fault.what();
} catch (const std::exception&) {  // without memory the next refusal tells it
}

void Service::journal_takes_again() noexcept try {
  if (journal_fault_.empty()) return;
  journal_fault_.clear();
  log("the journal takes requests again");
} catch (const std::exception&) {
}

void Service::recover() {
  if (store_ == nullptr) return;
  replaying_ = true;
  store_->recover(*this);
  replaying_ = false;
  epoch_ = options_.epoch;
  claims_ = 0;
  for (const auto& [id, member] : members_) {
    member->epoch = 0;
    member->proven_sequence = member->conversation.last_sequence();
  }
  if (store_->left_something_out() && !checkpoint())
    throw store::StorageError("the states without what was dropped could not be kept", EIO);
  times_ = {};
  metrics_.node_steps = metrics_.solver_ns = 0;  // these steps were counted by the server that first ran the requests
}

void Service::prove_last_replies() noexcept try {
  constexpr std::uint64_t kQuietNs = 1'000'000'000;
  if (store_ == nullptr || !store_->journaling() || failed()) return;
  bool proven = false;
  const std::uint64_t now_ns = options_.now_ns();
  for (const auto& [id, member] : members_) {
    const std::uint64_t last = member->conversation.last_sequence();
    if (!member->shard || member->running || member->long_request || member->proven_sequence == last) continue;
    if (now_ns - member->last_request_ns < kQuietNs) continue;
    store_->append({.session = id, .sequence = last, .previous_reply = sum_of(member->conversation)});
    member->proven_sequence = last;
    proven = true;
  }
  if (!proven) return;
  settle();
  journal_takes_again();
} catch (const std::exception& fault) {  // a final failure of the journal ends the server; a full disk is tried again
  tell_of_journal(fault);
}

std::optional<ReplyFrames> Service::refuse_while_recovering(Frames frames) const noexcept try {
  wire::Request request;
  wire::Reply reply;
  reply.epoch = options_.epoch;
  try {
    wire::decode(frames, request);
    refuse(Code::kRecovering, "",
           fmt::format("the server replays the requests since its last checkpoint: {:.0f} % are done",
                       100.0 * store_->share_replayed()),
           "Wait, and send the same request again. To leave out a session that takes too long, stop "
           "the server and start it with --drop-session.");
  } catch (const Error& fault) {
    reply.status = fault.status();
  }
  reply.request_id = request.request_id;
  reply.session_id = request.session_id;
  reply.sequence = request.sequence;
  return ReplyFrames{.header = wire::encode_header(reply)};
} catch (const std::exception&) {
  return std::nullopt;
}

void Service::clear() {
  members_.clear();
  closed_.clear();
  transfers_.clear();
  metrics_ = {};
}

void Service::restore(const store::Snapshot& snapshot) {
  for (const store::SessionImage& image : snapshot.sessions) {
    auto member = std::make_unique<Member>();
    static_cast<store::SessionFacts&>(*member) = image;
    member->opened_ns = member->last_request_ns = started_ns_;
    const bool follows = !image.before_header.empty();
    if (follows)
      member->conversation.complete(image.last_sequence - 1, image.before_hash,
                                    reply_from(image.before_header, image.before_payload));
    member->conversation.complete(image.last_sequence, image.last_hash,
                                  reply_from(image.reply_header, image.reply_payload), follows);
    if (!image.open) {
      closed_[image.identity].push_back(image.id);
    } else {
      SceneModel made = scene_model(image.scene, "the checkpoint's scene");
      member->pairs = SessionPairs(made, SessionPairs::parameters_in(image.committed));
      member->scene_name = std::move(made.name);
      member->scene = std::move(made.effective);
      member->shard = restored_shard(member->pairs, member->pairs.table(made.options), image.node_ids, image.committed);
      member->shard->restore(image.committed, image.trial ? &*image.trial : nullptr, image.state_version);
      if (!image.part_header.empty()) member->parts = parts_from(image, *member->shard);
      for (const store::MarkImage& mark : image.marks)
        member->marks.push_back(std::make_shared<const store::MarkImage>(mark));
      ++metrics_.sessions;
      metrics_.nodes += image.node_ids.size();
      metrics_.state_bytes += member->held_bytes();
    }
    members_[image.id] = std::move(member);
  }
  for (const store::TransferImage& transfer : snapshot.transfers) {
    metrics_.nodes += transfer.node_ids.size();
    metrics_.state_bytes += kept_bytes(transfer.states);
    transfers_.emplace(transfer.id, std::make_shared<const store::TransferImage>(transfer));
  }
  for (const store::PendingRequest& request : snapshot.pending) {
    previous_committed_ = request.previous_committed;
    run_again(request.header_frame, request.payload_frame, {}, request.epoch);
    previous_committed_ = false;
  }
}

// Runs a request that has run before, or was begun, on a server of the given epoch.
void Service::run_again(std::span<const std::byte> header, std::span<const std::byte> payload,
                        std::string_view identity, std::uint64_t epoch) {
  epoch_ = epoch;
  auto fresh = std::make_shared<wire::Reply>();
  fresh->epoch = epoch;
  if (answer(wire::frames_of({header, payload}), {.identity = identity, .in_process = true}, fresh) != fresh)
    refuse(Code::kSequenceReused, "", "it has run already", "");
}

void Service::replay(const store::Record& record, std::uint64_t epoch) {
  const auto of_record = [&](const std::string& why) {
    return fmt::format("journal record {} (request {} of session {}): {}", record.index, record.sequence,
                       short_name(record.session), why);
  };
  const auto known = members_.find(record.session);
  if (known != members_.end() && known->second->shard && sum_of(known->second->conversation) != record.previous_reply)
    throw store::DamagedFile(
        of_record("replaying the one before gave other numbers than the server answered with. Recover with the build "
                  "that wrote it, on the same kind of machine"));
  if (options_.while_replaying) options_.while_replaying();
  if (record.header_frame.empty()) return;
  granted_epoch_ = record.sequence;
  try {
    run_again(record.header_frame, record.payload_frame, record.identity, epoch);
  } catch (const Error& fault) {
    throw store::OtherOptions(of_record(
        fmt::format("it is refused now: {} Start the server with the options that it had; or leave the session out: "
                    "--drop-session {}",
                    describe(fault.status()), short_name(record.session))));
  }
}

void Service::change_scene(const wire::SessionId& session, const std::string& scene, const std::string& scene_file) {
  const std::string effective = scene_model(scene, scene_file).effective;
  store::Snapshot states = snapshot();
  std::exchange(states.complete, nullptr)(states);
  for (store::SessionImage& image : states.sessions)
    if (image.id == session) image.scene = effective;
  clear();
  restore(states);
}

}  // namespace shearbus::service
