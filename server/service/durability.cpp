// Durability of sessions: the journal record of a request before it runs, checkpoints, recovery by replay, and
// resume_session.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <limits>
#include <new>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>
#include <variant>

#include "proto/wire/codec.hpp"
#include "server/service/member.hpp"
#include "server/service/scene_model.hpp"
#include "server/service/service.hpp"
#include "server/shard/cut.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Error;

namespace {

constexpr const char* kNoMemoryForCheckpoint =
    "the checkpoint found no memory; the ones before and the journal hold everything";

std::vector<std::byte> copy_of(std::span<const std::byte> bytes) {
  return {bytes.begin(), bytes.end()};
}

// A decoded reply, together with the bytes that its columns point into.
struct HeldReply {
  std::vector<std::byte> payload;
  wire::Reply reply;
};

std::shared_ptr<wire::Reply> reply_from(const std::vector<std::byte>& header, const std::vector<std::byte>& payload) {
  auto held = std::make_shared<HeldReply>();
  held->payload = payload;
  const std::array<std::span<const std::byte>, 2> frames = {header, held->payload};
  wire::decode_trusted(std::span(frames).first(wire::declares_payload(header) ? 2 : 1), held->reply);
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
    throw Error(
        {.code = Code::kNoSpace,
         .text = fmt::format("the request could not be kept: {}", fault.what()),
         .remedy = "Nothing was changed. Make room in the server's state directory; the same request again goes on."});
  }
  journaled_now_ = store_->journaling();
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
  if (proven) settle();
} catch (const std::exception& fault) {  // a final failure of the journal ends the server; a full disk is tried again
  log(std::string("the last reply of a session could not be proven: ") + fault.what());
}

std::optional<ReplyFrames> Service::refuse_while_recovering(Frames frames) const noexcept try {
  wire::Request request;
  wire::Reply reply;
  reply.epoch = options_.epoch;
  try {
    wire::decode(frames, request);
    throw Error({.code = Code::kRecovering,
                 .text = fmt::format("the server replays the requests since its last checkpoint: {:.0f} % are done",
                                     100.0 * store_->share_replayed()),
                 .remedy = "Wait, and send the same request again. To leave out a session that takes too long, stop "
                           "the server and start it with --drop-session."});
  } catch (const Error& fault) {
    reply.status = fault.status();
  }
  reply.request_id = request.request_id;
  reply.session_id = request.session_id;
  reply.sequence = request.sequence;
  return ReplyFrames{.header = wire::encode_header(reply), .payload = {}, .owner = {}};
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
  const std::array<std::span<const std::byte>, 2> frames = {header, payload};
  auto fresh = std::make_shared<wire::Reply>();
  fresh->epoch = epoch;
  if (answer(std::span(frames).first(wire::declares_payload(header) ? 2 : 1),
             {.identity = identity, .in_process = true}, fresh) != fresh)
    throw Error({.code = Code::kSequenceReused, .text = "it has run already"});
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
  if (options_.while_replaying) options_.while_replaying();
  if (record.header_frame.empty()) return;
  granted_epoch_ = record.sequence;
  try {
    run_again(record.header_frame, record.payload_frame, record.identity, epoch);
  } catch (const Error& fault) {
    refuse(std::string("it is refused now: ") + fault.what());
  }
}

namespace {

// What a snapshot of a session refers to until it is complete.
struct Unread {
  std::size_t session = 0;  // place in Snapshot::sessions
  std::shared_ptr<const wire::Reply> last;
  std::shared_ptr<const wire::Reply> before;
  std::shared_ptr<shard::Cut> cut;
  std::vector<std::shared_ptr<const store::MarkImage>> marks;

  void put_into(store::SessionImage& image) {
    image.reply_payload = copy_of(last->batch.bytes());
    if (before) image.before_payload = copy_of(before->batch.bytes());
    for (const auto& mark : marks) image.marks.push_back(*mark);
    shard::Cut::Contents contents = cut->read();
    cut.reset();
    image.node_ids = std::move(contents.node_ids);
    image.committed = std::move(contents.committed);
    image.trial = std::move(contents.trial);
  }
};

struct AllUnread {
  std::vector<Unread> sessions;
  std::vector<std::shared_ptr<const store::TransferImage>> transfers;
  std::vector<std::shared_ptr<PendingFrames>> pending;  // one for each of Snapshot::pending

  void put_into(store::Snapshot& snapshot) {
    for (Unread& unread : sessions) unread.put_into(snapshot.sessions[unread.session]);
    for (const auto& transfer : transfers) snapshot.transfers.push_back(*transfer);
    for (std::size_t i = 0; i < pending.size(); ++i) {
      auto frames = pending[i]->take();
      snapshot.pending[i].header_frame = std::move(frames[0]);
      snapshot.pending[i].payload_frame = std::move(frames[1]);
    }
  }
};

// The header of a reply as it is sent again. The file that holds it has a sum of the payload, too.
std::vector<std::byte> header_to_repeat(wire::Reply& reply) {
  make_repeat(reply);
  const std::string header = wire::encode_header(reply, {}, wire::PayloadSum::kLeftOut);
  return copy_of(std::as_bytes(std::span(header)));
}

std::vector<std::uint32_t> rows_of_parts(const Parts& parts, const shard::NodeTable& nodes) {
  std::vector<std::uint32_t> rows;
  for (std::uint32_t row = 0; row < nodes.size(); ++row)
    if (parts.stepped[nodes.slot_of(row)]) rows.push_back(row);
  return rows;
}

}  // namespace

// The states at this moment. What takes long to copy is left to whoever reads the snapshot (Snapshot::complete).
store::Snapshot Service::snapshot() {
  store::Snapshot snapshot{.next_index = 0, .server_version = options_.server_version, .sessions = {}, .transfers = {}};
  const auto unread = std::make_shared<AllUnread>();
  const auto add = [&](const Member& member) {
    const ReplyPtr& last = member.conversation.kept_reply();
    store::SessionImage image;
    static_cast<store::SessionFacts&>(image) = member;
    image.open = member.shard != nullptr;
    image.last_sequence = member.conversation.last_sequence();
    image.last_hash = member.conversation.last_hash();
    image.reply_header = header_to_repeat(*last);
    if (member.shard) {
      image.state_version = member.shard->state_version();
      const session::Kept& before = member.conversation.before();
      if (before.reply) {
        image.before_hash = before.hash;
        image.before_header = header_to_repeat(*before.reply);
      }
      if (member.parts) {
        const std::string part = wire::encode_header(wire::Request{.body = member.parts->last});
        image.part_header = copy_of(std::as_bytes(std::span(part)));
        image.part_rows = rows_of_parts(*member.parts, member.shard->nodes());
      }
      unread->sessions.push_back({.session = snapshot.sessions.size(),
                                  .last = last,
                                  .before = before.reply,
                                  .cut = member.shard->cut(),
                                  .marks = member.marks});
    }
    snapshot.sessions.push_back(std::move(image));
  };
  for (const auto& [identity, ids] : closed_)
    for (const wire::SessionId& id : ids) add(*members_.at(id));
  for (const auto& [id, member] : members_)
    if (member->shard) add(*member);
  for (const auto& [id, transfer] : transfers_) unread->transfers.push_back(transfer);
  for (const Member* member : journaled_) {
    RunningStep& running = *member->running;
    snapshot.pending.push_back({.session = member->id,
                                .epoch = epoch_,
                                .previous_committed = running.step().commit_previous,
                                .header_frame = {},
                                .payload_frame = {}});
    running.pending = std::make_shared<PendingFrames>(running.frames);
    unread->pending.push_back(running.pending);
  }
  snapshot.complete = [unread](store::Snapshot& made) { unread->put_into(made); };
  return snapshot;
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

bool Service::checkpoint() {
  if (store_ == nullptr || failed()) return false;
  finish_changes();
  end_checkpoint(true);
  if (options_.around_checkpoint) options_.around_checkpoint(true);
  bool written = false;
  try {
    written = timed(options_.now_ns, times_.checkpoint, [&] { return store_->checkpoint(snapshot()); });
  } catch (const std::bad_alloc&) {
    log(kNoMemoryForCheckpoint);
  }
  if (options_.around_checkpoint) options_.around_checkpoint(false);
  if (written) last_checkpoint_ns_ = options_.now_ns();
  return written;
}

void Service::begin_checkpoint() {
  if (store_ == nullptr || failed() || job_ || changing()) return;
  const Longest measured(options_.cpu_ns, metrics_.longest_turn_ns);
  if (options_.around_checkpoint) options_.around_checkpoint(true);
  job_started_ns_ = options_.now_ns();
  try {
    job_ = store_->begin_checkpoint(snapshot());
  } catch (const std::bad_alloc&) {
    log(kNoMemoryForCheckpoint);
    if (options_.around_checkpoint) options_.around_checkpoint(false);
    return;
  }
  try {
    aside_.start([this] { store_->write(*job_); });
  } catch (const std::exception&) {  // no thread: everybody waits for the write
    store_->write(*job_);
  }
}

// The same for a request, which lets others have their turn while it waits for the checkpoint that may be under way and
// for its own.
bool Service::checkpoint_in_turn() {
  constexpr std::uint64_t kLong = std::numeric_limits<std::uint64_t>::max();
  if (turn_of_ == nullptr && !may_step_aside_) return checkpoint();
  aside(kLong, [] {});  // before anything is changed
  while (job_ || changing()) {
    aside(kLong, [this] {
      aside_.wait_for_end();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));  // for changes, too
    });
    end_checkpoint(false);
  }
  begin_checkpoint();
  const auto own = job_;
  const std::uint64_t before = store_->counters().checkpoints;
  if (!own) return false;
  aside(kLong, [this] { aside_.wait_for_end(); });
  if (job_ == own) end_checkpoint(true);
  return store_->counters().checkpoints > before;
}

void Service::end_checkpoint(bool wait) noexcept try {
  if (!job_ || (!wait && !aside_.done())) return;
  aside_.wait();
  const bool written = store_->end_checkpoint(*job_);
  job_.reset();
  const std::uint64_t now = options_.now_ns();
  times_.checkpoint.add(now - job_started_ns_);
  if (options_.around_checkpoint) options_.around_checkpoint(false);
  if (written) last_checkpoint_ns_ = now;
} catch (const std::exception& fault) {
  log(std::string("a checkpoint could not be completed: ") + fault.what());
}

// Lets the claimant own the session. The claim is journaled, so that the clients before it stay superseded after a
// restart. Its record has the granted epoch as its sequence.
void Service::grant(Member& member, const wire::ResumeSession& resume, const Arrival& arrival) {
  constexpr std::size_t kMostRemembered = 32;
  std::vector<std::uint64_t> superseded = member.superseded;
  for (const std::uint64_t epoch : {member.owner_epoch, epoch_})
    if (epoch != 0 && std::ranges::find(superseded, epoch) == superseded.end()) superseded.push_back(epoch);
  if (superseded.size() > kMostRemembered) superseded.erase(superseded.begin(), superseded.end() - kMostRemembered);
  const std::uint64_t granted = replaying_ ? granted_epoch_ : epoch_ + claims_ + 1;
  journal(arrival, member.id, &member, granted);
  ++claims_;
  member.superseded = std::move(superseded);
  member.claim = resume.claim;
  member.claimant = resume.claimant;
  member.epoch = member.owner_epoch = granted;
}

Service::ReplyPtr Service::resume(const wire::ResumeSession& resume, Arrival& arrival, const ReplyPtr& reply) {
  const wire::Request& request = arrival.request;
  const auto found = members_.find(request.session_id);
  if (found == members_.end() || !found->second->shard)
    throw Error({.code = Code::kUnknownSession,
                 .text = "no open session has this id",
                 .remedy = "Open a new session and start again from the host's last restart point."});
  Member& member = *found->second;
  check_identity(member, arrival.caller);
  if (must_wait(member)) return reply;
  if (member.resume_token == wire::ResumeToken{} || !same_token(member.resume_token, resume.resume_token))
    throw Error({.code = Code::kResumeRefused,
                 .text = "the resume token is not the one the session was opened with",
                 .remedy = "Only the client that opened the session, or one it gave its token, may resume it."});
  // A claim is repeated only within the epoch of the server that granted it.
  const bool repeated = member.epoch != 0 && resume.claim == member.claim && resume.claimant == member.claimant;
  if (resume.claim != 0 && !repeated) {
    if (request.epoch != epoch_)
      throw Error({.code = Code::kEpoch,
                   .text = fmt::format("the claim is for server epoch {:016x}; this is {:016x}", request.epoch, epoch_),
                   .remedy = "Ask where the session stands, and claim it with the epoch and number of that reply."});
    if (resume.claim != member.claim + 1)
      throw Error(
          {.code = Code::kSuperseded,
           .text = fmt::format("claim {} of the session, after claim {} was granted", resume.claim, member.claim),
           .remedy = "Ask where the session stands, and claim it if its client is known to be gone."});
  }
  hold(member);
  const shard::Shard& shard = *member.shard;
  aside(64 * shard.nodes().size(), [&] { reply->batch = member.pairs.columns_of_nodes(shard); });
  if (resume.claim != 0 && !repeated) grant(member, resume, arrival);
  reply->body = wire::SessionResumed{.session = opened(member),
                                     .last_sequence = member.conversation.last_sequence(),
                                     .state_version = shard.state_version(),
                                     .trial_stands = member.trial_stands(),
                                     .claim = member.claim,
                                     .offers = offers_of(member),
                                     .claimant = member.claimant};
  if (resume.claim != 0) reply->epoch = member.epoch;
  return reply;
}

}  // namespace shearbus::service
