// Checkpoints: the states of all sessions at one moment, written while requests are answered.
#include <chrono>
#include <limits>
#include <memory>
#include <new>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "proto/wire/codec.hpp"
#include "server/service/member.hpp"
#include "server/service/service.hpp"
#include "server/shard/cut.hpp"

namespace shearbus::service {

namespace {

std::vector<std::byte> copy_of(std::span<const std::byte> bytes) {
  return {bytes.begin(), bytes.end()};
}

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
  store::Snapshot snapshot{.server_version = options_.server_version};
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
    snapshot.pending.push_back(
        {.session = member->id, .epoch = epoch_, .previous_committed = running.step().commit_previous});
    running.pending = std::make_shared<PendingFrames>(running.frames);
    unread->pending.push_back(running.pending);
  }
  snapshot.complete = [unread](store::Snapshot& made) { unread->put_into(made); };
  return snapshot;
}

bool Service::checkpoint() {
  if (store_ == nullptr || failed()) return false;
  finish_changes();
  end_checkpoint(true);
  begin_checkpoint(false);
  return end_checkpoint(true);
}

void Service::begin_checkpoint(bool aside) {
  if (store_ == nullptr || failed() || job_ || changing()) return;
  std::optional<Longest> measured;
  if (aside) measured.emplace(options_.cpu_ns, metrics_.longest_turn_ns);
  if (options_.around_checkpoint) options_.around_checkpoint(true);
  job_started_ns_ = options_.now_ns();
  try {
    job_ = store_->begin_checkpoint(snapshot());
  } catch (const std::bad_alloc&) {
    log("ALARM: the checkpoint found no memory; the ones before and the journal hold everything");
    if (options_.around_checkpoint) options_.around_checkpoint(false);
    return;
  }
  try {
    if (aside) return aside_.start([this] { store_->write(*job_); });
  } catch (const std::exception&) {  // no thread: everybody waits for the write
  }
  store_->write(*job_);
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

bool Service::end_checkpoint(bool wait) noexcept try {
  if (!job_ || (!wait && !aside_.done())) return false;
  aside_.wait();
  const bool written = store_->end_checkpoint(*job_);
  job_.reset();
  const std::uint64_t now = options_.now_ns();
  times_.checkpoint.add(now - job_started_ns_);
  if (options_.around_checkpoint) options_.around_checkpoint(false);
  if (written) last_checkpoint_ns_ = now;
  return written;
} catch (const std::exception& fault) {
  log(std::string("ALARM: a checkpoint could not be completed: ") + fault.what());
  return false;
}

}  // namespace shearbus::service
