// Durability of sessions: the journal record of a request before it runs, checkpoints, recovery by replay, and
// resume_session.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>
#include <variant>

#include "proto/wire/codec.hpp"
#include "server/service/member.hpp"
#include "server/service/scene_model.hpp"
#include "server/service/service.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Error;

namespace {

std::vector<std::byte> copy_of(std::span<const std::byte> bytes) {
  return {bytes.begin(), bytes.end()};
}

// A decoded reply, together with the bytes that its columns point into.
struct HeldReply {
  std::vector<std::byte> payload;
  wire::Reply reply;
};

std::shared_ptr<wire::Reply> reply_from(const store::SessionImage& image) {
  auto held = std::make_shared<HeldReply>();
  held->payload = image.reply_payload;
  const std::array<std::span<const std::byte>, 2> frames = {image.reply_header, held->payload};
  wire::decode(std::span(frames).first(wire::declares_payload(image.reply_header) ? 2 : 1), held->reply);
  return {held, &held->reply};
}

Parts parts_from(const store::SessionImage& image, const shard::NodeTable& nodes) {
  const std::span<const std::byte> frame = image.part_header;
  wire::Request request;
  wire::decode(std::span(&frame, 1), request);
  Parts parts{.last = std::get<wire::Downscale>(request.body), .stepped = std::vector<bool>(nodes.size())};
  for (const std::uint32_t row : image.part_rows) parts.stepped.at(nodes.slot_of(row)) = true;
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

// Takes the same time for equal and different tokens, so that the time gives no hint at a guessed token.
bool same_token(const wire::ResumeToken& a, const wire::ResumeToken& b) {
  unsigned difference = 0;
  for (std::size_t i = 0; i < a.size(); ++i) difference |= static_cast<unsigned>(a[i] ^ b[i]);
  return difference == 0;
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
void Service::keep(const Arrival& arrival, const wire::SessionId& session, const Member* member) {
  if (store_ == nullptr || replaying_) return;
  try {
    timed(options_.now_ns, times_.journal_append, [&] {
      store_->append({.session = session,
                      .sequence = arrival.request.sequence,
                      .previous_reply = member != nullptr ? sum_of(member->conversation) : 0,
                      .header_frame = arrival.frames[0],
                      .payload_frame = arrival.frames.size() > 1 ? arrival.frames[1] : std::span<const std::byte>(),
                      .identity = member != nullptr ? std::string_view() : arrival.caller.identity});
    });
  } catch (const store::StorageError& fault) {
    if (store_->failed()) throw;
    throw Error(
        {.code = Code::kNoSpace,
         .text = fmt::format("the request could not be kept: {}", fault.what()),
         .remedy = "Nothing was changed. Make room in the server's state directory; the same request again goes on."});
  }
  kept_ = store_->journaling();
}

void Service::recover() {
  if (store_ == nullptr) return;
  replaying_ = true;
  store_->recover(*this);
  replaying_ = false;
  epoch_ = options_.epoch;
  times_ = {};
  metrics_.node_steps = metrics_.solver_ns = 0;  // these steps were counted by the server that first ran the requests
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
    member->id = image.id;
    member->identity = image.identity;
    member->opened_ns = member->last_request_ns = started_ns_;
    member->resume_token = image.resume_token;
    member->conversation.complete(image.last_sequence, image.last_hash, reply_from(image));
    member->totals = {.requests = image.requests, .node_steps = image.node_steps, .solver_ns = image.solver_ns};
    if (!image.open) {
      closed_[image.identity].push_back(image.id);
    } else {
      SceneModel made = scene_model(image.scene, "the checkpoint's scene");
      physics::Model model(made.options);
      member->scene_name = std::move(made.name);
      member->scene = std::move(made.effective);
      member->idle_limit_s = image.idle_limit_s;
      member->shard = make_shard(std::move(model), image.node_ids, shard::checks_closure(image.committed));
      member->shard->restore(image.committed, image.trial ? &*image.trial : nullptr, image.state_version);
      if (!image.part_header.empty()) member->parts = parts_from(image, member->shard->nodes());
      member->marks = image.marks;
      member->domain = image.domain;
      ++metrics_.sessions;
      metrics_.nodes += image.node_ids.size();
      metrics_.state_bytes += member->held_bytes();
    }
    members_[image.id] = std::move(member);
  }
  for (const store::TransferImage& transfer : snapshot.transfers) {
    metrics_.nodes += transfer.node_ids.size();
    metrics_.state_bytes += kept_bytes(transfer.states);
    transfers_.emplace(transfer.id, transfer);
  }
}

void Service::replay(const store::Record& record, std::uint64_t epoch) {
  const auto refuse = [&](const std::string& why) {
    throw store::DamagedFile(fmt::format("journal record {} (request {} of session {:02x}{:02x}{:02x}{:02x}): {}",
                                         record.index, record.sequence, record.session[0], record.session[1],
                                         record.session[2], record.session[3], why));
  };
  const auto known = members_.find(record.session);
  if (known != members_.end() && known->second->shard && sum_of(known->second->conversation) != record.previous_reply)
    refuse(
        "replaying the one before gave other numbers than the server answered with. Recover with the build that wrote "
        "it, "
        "on the same kind of machine");
  epoch_ = epoch;
  const std::array<std::span<const std::byte>, 2> frames = {record.header_frame, record.payload_frame};
  auto fresh = std::make_shared<wire::Reply>();
  fresh->epoch = epoch;
  try {
    if (answer(std::span(frames).first(wire::declares_payload(record.header_frame) ? 2 : 1),
               {.identity = record.identity}, fresh) != fresh)
      refuse("it stands in the journal twice");
  } catch (const Error& fault) {
    refuse(std::string("it is refused now: ") + fault.what());
  }
}

store::Snapshot Service::snapshot() const {
  store::Snapshot snapshot{.next_index = 0, .server_version = options_.server_version, .sessions = {}, .transfers = {}};
  const auto add = [&](const Member& member) {
    wire::Reply& kept = *member.conversation.kept_reply();
    make_repeat(kept);
    const std::string header = wire::encode_header(kept);
    store::SessionImage image{.id = member.id,
                              .open = member.shard != nullptr,
                              .identity = member.identity,
                              .resume_token = member.resume_token,
                              .last_sequence = member.conversation.last_sequence(),
                              .last_hash = member.conversation.last_hash(),
                              .reply_header = copy_of(std::as_bytes(std::span(header))),
                              .reply_payload = copy_of(kept.batch.bytes()),
                              .requests = member.totals.requests,
                              .node_steps = member.totals.node_steps,
                              .solver_ns = member.totals.solver_ns};
    if (member.shard) {
      image.domain = member.domain;
      image.idle_limit_s = member.idle_limit_s;
      image.scene = member.scene;
      image.node_ids = member.shard->nodes().ids();
      image.state_version = member.shard->state_version();
      image.committed = member.shard->committed_states();
      image.marks = member.marks;
      if (member.shard->has_trial()) image.trial = member.shard->trial_states();
      if (member.parts) {
        const std::string part = wire::encode_header(wire::Request{.body = member.parts->last});
        image.part_header = copy_of(std::as_bytes(std::span(part)));
        for (std::uint32_t row = 0; row < member.shard->nodes().size(); ++row)
          if (member.parts->stepped[member.shard->nodes().slot_of(row)]) image.part_rows.push_back(row);
      }
    }
    snapshot.sessions.push_back(std::move(image));
  };
  for (const auto& [identity, ids] : closed_)
    for (const wire::SessionId& id : ids) add(*members_.at(id));
  for (const auto& [id, member] : members_)
    if (member->shard) add(*member);
  for (const auto& [id, transfer] : transfers_) snapshot.transfers.push_back(transfer);
  return snapshot;
}

bool Service::checkpoint() {
  if (store_ == nullptr || failed()) return false;
  if (options_.around_checkpoint) options_.around_checkpoint(true);
  bool written = false;
  try {
    written = timed(options_.now_ns, times_.checkpoint, [&] { return store_->checkpoint(snapshot()); });
  } catch (const std::bad_alloc&) {
    log("the checkpoint found no memory; the ones before and the journal hold everything");
  }
  if (options_.around_checkpoint) options_.around_checkpoint(false);
  if (written) last_checkpoint_ns_ = options_.now_ns();
  return written;
}

Service::ReplyPtr Service::resume(const wire::ResumeSession& resume, const Arrival& arrival, const ReplyPtr& reply) {
  const wire::Request& request = arrival.request;
  const auto found = members_.find(request.session_id);
  if (found == members_.end() || !found->second->shard)
    throw Error({.code = Code::kUnknownSession,
                 .text = "no open session has this id",
                 .remedy = "Open a new session and start again from the host's last restart point."});
  Member& member = *found->second;
  check_identity(member, arrival.caller);
  if (member.resume_token == wire::ResumeToken{} || !same_token(member.resume_token, resume.resume_token))
    throw Error({.code = Code::kResumeRefused,
                 .text = "the resume token is not the one the session was opened with",
                 .remedy = "Only the client that opened the session, or one it gave its token, may resume it."});
  if (resume.claim != 0 && (resume.claim != member.claim || resume.claimant != member.claimant)) {
    if (request.epoch != epoch_)  // the numbering of claims starts again with every start of the server
      throw Error({.code = Code::kEpoch,
                   .text = fmt::format("the claim is for server epoch {:016x}; this is {:016x}", request.epoch, epoch_),
                   .remedy = "Ask where the session stands, and claim it with the epoch and number of that reply."});
    if (resume.claim != member.claim + 1)
      throw Error(
          {.code = Code::kSuperseded,
           .text = fmt::format("claim {} of the session, after claim {} was granted", resume.claim, member.claim),
           .remedy = "Ask where the session stands, and claim it if its client is known to be gone."});
    member.claim = resume.claim;
    member.claimant = resume.claimant;
    member.epoch = epoch_ + ++claims_;
  }
  const shard::Shard& shard = *member.shard;
  reply->body = wire::SessionResumed{.session = opened(member),
                                     .last_sequence = member.conversation.last_sequence(),
                                     .state_version = shard.state_version(),
                                     .trial_stands = member.trial_stands(),
                                     .claim = member.claim,
                                     .offers = offers_of(member)};
  reply->batch = node_column(shard.nodes().ids());
  if (resume.claim != 0) reply->epoch = member.epoch;
  return reply;
}

}  // namespace shearbus::service
