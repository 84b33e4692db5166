// Several servers after a crash of the client, and at the end of the session.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <exception>
#include <utility>
#include <variant>

#include "client/src/sharded_session.hpp"

namespace shearbus {

void ShardedSession::reconcile(std::span<const wire::SessionResumed> positions) {
  std::vector<std::uint64_t> versions;
  for (const wire::SessionResumed& position : positions) versions.push_back(position.state_version);
  const std::uint64_t newest = std::ranges::max(versions);
  operation_ = Operation{};
  operation_->stage = Stage::kCommit;  // so that a fault leaves the outcome open
  std::vector<bool> stands;
  for (std::size_t k = 0; k < shards_.size(); ++k) {
    const bool behind = versions[k] + 1 == newest && positions[k].trial_stands;
    if (behind) {
      ask(shards_[k], wire::Commit{});
      versions[k] = newest;
    }
    stands.push_back(positions[k].trial_stands && !behind);
  }
  trial_stands_ = std::ranges::find(stands, true) != stands.end();
  if (!all_equal(versions)) {
    for (Shard& shard : shards_) shard.open = false;
    torn_ = fmt::format("the shards are not at the same step: their state versions are {}", fmt::join(versions, ", "));
    operation_.reset();
    return;
  }
  post_all();
  settle();
  if (trial_stands_ && std::ranges::find(stands, false) != stands.end()) {
    trial_stands_ = false;
    for (std::size_t k = 0; k < shards_.size(); ++k)
      if (stands[k]) ask(shards_[k], wire::Rollback{});
    post_all();
    settle();
  }
  for (const Shard& shard : shards_)
    if (shard.refusal) torn_ = fmt::format("the shards are not at the same step: {}", shard.refusal->what());
  state_version_ = newest;
  operation_.reset();
}

wire::SessionResumed ShardedSession::position() const {
  wire::SessionResumed position{
      .last_sequence = last_sequence_, .state_version = state_version_, .trial_stands = trial_stands_};
  for (const Shard& shard : shards_)
    for (const TransferId& offer : shard.session->offers)
      if (std::ranges::find(position.offers, offer) == position.offers.end()) position.offers.push_back(offer);
  return position;
}

Received ShardedSession::close(const wire::Request& request) {
  operation_.reset();
  ahead_.reset();
  std::optional<Error> fault;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    Shard& shard = shards_[k];
    for (int attempt = 0; !shard.session->closed && attempt < 2; ++attempt) {
      try {
        ask(shard, std::get<wire::CloseSession>(request.body));
        shard.open = false;
        links_.left(k);
        shard.reply = shard.session->exchange(shard.request);
        shard.session->closed = true;
      } catch (const Error& refusal) {
        // A request that was interrupted has run: the session stands behind it now.
        if (refusal.status().code == Code::kSequenceReused && attempt == 0) continue;
        if (!fault) fault = refusal;
        break;
      }
    }
  }
  if (fault) throw Error(*fault);
  wire::SessionClosed totals;
  for (Shard& shard : shards_) {
    const auto& one = body_of<wire::SessionClosed>(*shard.reply);
    totals.requests += one.requests;
    totals.node_steps += one.node_steps;
    totals.solver_ns += one.solver_ns;
    totals.asleep_node_steps += one.asleep_node_steps;
  }
  Received received;
  received.reply.body = totals;
  return received;
}

void ShardedSession::say_close(const wire::Request& request) noexcept try {
  for (Shard& shard : shards_) {
    if (shard.session->closed) continue;
    wire::Request goodbye = shard.session->next_request();
    if (operation_ && shard.open) ++goodbye.sequence;  // the request under way runs before the closing one
    if (ahead_) ++goodbye.sequence;
    if (goodbye.request_id == 0) goodbye.request_id = shard.session->connection->next_request_id();
    goodbye.body = request.body;
    shard.session->connection->say(goodbye);
  }
} catch (const std::exception&) {
  // Without memory for the closing request the sessions stay open on the servers.
}

}  // namespace shearbus
