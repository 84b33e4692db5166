// An operation under way on several servers: waits for the answers of the shards, decides what follows them, and undoes
// what some have refused.
#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <variant>

#include "client/src/sharded_session.hpp"

namespace shearbus {
namespace {

// True for a status that says that the request was not run and cannot run later. After any other status the outcome on
// this shard is open.
bool is_refusal(Code code, bool of_opening) {
  const int kind = static_cast<int>(code) / 100;
  switch (code) {
    case Code::kDraining:
      return of_opening;
    case Code::kNothingToCommit:
    case Code::kUnknownMark:
    case Code::kTrialStands:
    case Code::kUnknownTransfer:
    case Code::kNotPermitted:
      return true;
    default:
      return kind == 1 || kind == 3 || (kind == 2 && of_opening);
  }
}

}  // namespace

// Waits for the answers of all shards. Throws the first fault that leaves the outcome on a shard open. An opening that
// one shard refuses is refused, whatever becomes of it on the others.
void ShardedSession::settle() {
  const bool opens = asks<wire::OpenSession>(operation_->question);
  bool refused = operation_->refusal.has_value();
  bool may_have_run = operation_->stage != Stage::kAsked;
  std::optional<Error> unsettled;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    Asked& asked = operation_->asked[k];
    SessionState& session = *shards_[k].session;
    if (asked.open) {
      links_.left(k);
      try {
        asked.reply = session.exchange(asked.request);
        asked.open = false;
      } catch (const Error& fault) {
        if (is_refusal(fault.status().code, opens)) {
          asked.refusal = fault;
          asked.open = false;
        } else {
          may_have_run |= session.in_doubt.has_value();
          if (!unsettled) unsettled = fault;
        }
      }
    }
    refused |= asked.refusal.has_value();
    may_have_run |= asked.reply.has_value();
  }
  if (!unsettled || (opens && refused)) return;
  const Code code = unsettled->status().code;
  if (code != Code::kUnreachable && code != Code::kAuth) throw Error(*unsettled);
  if (!may_have_run) {
    operation_.reset();
    ahead_.reset();  // a part goes behind one that was sent
    throw Error(*unsettled);
  }
  wire::Status status = unsettled->status();
  status.code = Code::kUnknownOutcome;
  status.text += "; other shards may have run the request";
  status.remedy = "Make the same call again: where it has run, it is not run a second time.";
  throw Error(std::move(status));
}

Received ShardedSession::complete() {
  do {
    settle();
  } while (go_on());
  if (!operation_->refusal) {
    Received received = join();
    operation_.reset();
    return received;
  }
  const Error refusal = *operation_->refusal;
  place(node_ids_);  // an undone change of the nodes may have changed their order on a shard
  operation_.reset();
  throw Error(refusal);
}

// Decides what follows the answers of all shards. Returns true if further requests were sent.
bool ShardedSession::go_on() {
  Operation& operation = *operation_;
  std::vector<Asked>& asked = operation.asked;
  const auto is_refused = [](const Asked& of_shard) { return of_shard.refusal.has_value(); };
  const bool refused = std::ranges::any_of(asked, is_refused);
  const bool ran = std::ranges::any_of(asked, [](const Asked& of_shard) { return of_shard.reply.has_value(); });
  const auto* step = std::get_if<wire::Downscale>(&operation.question.body);
  const auto torn = [&](const char* what) {
    const auto at = std::ranges::find_if(asked, is_refused);
    torn_ = fmt::format("the shards are not at the same step: {} on shard {}: {}", what, at - asked.begin(),
                        describe(at->refusal->status()));
  };
  switch (operation.stage) {
    case Stage::kDropTrial:
      trial_stands_ = false;
      operation.stage = Stage::kAsked;
      ask_to_roll_back(std::get<wire::Rollback>(operation.question.body));
      break;
    case Stage::kAsked: {
      if (!refused) {
        const auto has_waited = [](const Asked& of_shard) { return !of_shard.reply; };
        if (asks<wire::Rollback>(operation.question) && std::ranges::any_of(asked, has_waited)) {
          for (std::size_t k = 0; k < asked.size(); ++k)
            if (has_waited(asked[k])) ask(k, operation.question.body);
          break;
        }
        if (step == nullptr || step->mode != wire::Mode::kAdvance || !last_of_step(*step)) return false;
        for (Asked& of_shard : asked) of_shard.answer = std::move(of_shard.reply);
        operation.stage = Stage::kCommit;
        ask_all(wire::Commit{});
        break;
      }
      const bool accepts = asks<wire::AcceptNodes>(operation.question);
      const auto holds_no_offer = [](const Asked& of_shard) {
        return of_shard.refusal && of_shard.refusal->status().code == Code::kUnknownTransfer;
      };
      const bool only_without_offer = std::ranges::all_of(
          asked, [&](const Asked& of_shard) { return !of_shard.refusal || holds_no_offer(of_shard); });
      if (accepts && ran && only_without_offer) return false;
      const auto first = std::ranges::find_if(asked, [&](const Asked& of_shard) {
        return of_shard.refusal && (only_without_offer || !holds_no_offer(of_shard));
      });
      wire::Status status = first->refusal->status();
      for (auto other = first + 1; other != asked.end(); ++other)
        if (other->refusal && other->refusal->status().code == status.code)
          status.node_ids.insert(status.node_ids.end(), other->refusal->status().node_ids.begin(),
                                 other->refusal->status().node_ids.end());
      status.node_ids.resize(std::min(status.node_ids.size(), wire::kMaxNodesNamed));
      operation.refusal.emplace(std::move(status));
      if (!ran) {
        ahead_.reset();  // each shard refuses the part behind one that it has refused
        return false;
      }
      if (asks<wire::Rollback, wire::Commit>(operation.question)) {
        torn(asks<wire::Commit>(operation.question) ? "the commit is refused" : "the rollback to a mark is refused");
        return false;
      }
      if (ahead_) {
        drain();
        return true;  // what these shards were sent
      }
      undo();
      break;
    }
    case Stage::kDrain:
      for (Asked& of_shard : asked)
        if (std::exchange(of_shard.ran_part, false)) of_shard.refusal.reset();
      undo();
      break;
    case Stage::kCommitPrevious:
      previous_committed_ = true;
      if (refused) torn("the trial before cannot be committed");
      go_back();
      break;
    case Stage::kCommit:
      if (refused) {
        torn("the commit of a step is refused");
        operation.refusal = Error({.code = Code::kEpoch, .text = torn_});
      }
      return false;
    case Stage::kUndo:
      if (refused) torn("a refused request cannot be undone");
      if (!refused && step != nullptr) state_version_ = body_of<wire::RolledBack>(*asked.front().reply).state_version;
      return false;
  }
  post_all();
  return true;
}

// Of a part that some shards have refused: the others may run the part behind it, whose answers are awaited first.
void ShardedSession::drain() {
  Operation ahead = *std::exchange(ahead_, std::nullopt);
  operation_->stage = Stage::kDrain;
  for (std::size_t k = 0; k < shards_.size(); ++k) {
    Asked& asked = operation_->asked[k];
    wire::Request& part = ahead.asked[k].request;
    if (!asked.reply || part.epoch != shards_[k].session->epoch) continue;  // a restarted shard has lost it
    asked.reply.reset();
    asked.ran_part = asked.open = true;
    asked.request = std::move(part);
  }
}

// After a refusal by some shards: those commit the trial before, if the others have, and all go back.
void ShardedSession::undo() {
  Operation& operation = *operation_;
  if (!asks<wire::Downscale>(operation.question) || !operation.commits_previous) return go_back();
  operation.stage = Stage::kCommitPrevious;
  for (std::size_t k = 0; k < shards_.size(); ++k)
    if (operation.asked[k].refusal) ask(k, wire::Commit{});
}

// Undoes a request on the shards that have run it, since others have refused it.
void ShardedSession::go_back() {
  Operation& operation = *operation_;
  operation.stage = Stage::kUndo;
  if (asks<wire::Downscale>(operation.question)) {
    trial_stands_ = false;
    return ask_all(wire::Rollback{});
  }
  for (std::size_t k = 0; k < shards_.size(); ++k) {
    Asked& asked = operation.asked[k];
    asked.open = false;  // where an opening has no answer the server keeps the session until an operator closes it
    asked.refusal.reset();
    if (!asked.reply) continue;
    if (asks<wire::OpenSession>(asked.request)) {
      ask(k, wire::CloseSession{.reason = "another server of the run has refused the session"});
    } else if (asks<wire::RegisterNodes>(asked.request)) {
      ask(k, wire::RetireNodes{}, named_nodes(asked.request.batch.u64(Field::kNodeId)));
    } else if (const auto* offer = std::get_if<wire::OfferNodes>(&asked.request.body)) {
      ask(k, wire::AcceptNodes{.transfer_id = offer->transfer_id});
    } else if (const auto* accept = std::get_if<wire::AcceptNodes>(&asked.request.body)) {
      ask(k, wire::OfferNodes{.transfer_id = accept->transfer_id},
          named_nodes(std::as_const(asked.reply->reply.batch).u64(Field::kNodeId)));
    }
  }
}

// ---- after a crash of the client ----

void ShardedSession::reconcile(std::span<const wire::SessionResumed> positions) {
  std::vector<std::uint64_t> versions;
  for (const wire::SessionResumed& position : positions) versions.push_back(position.state_version);
  const std::uint64_t newest = std::ranges::max(versions);
  operation_ = operation_of({}, 0);
  operation_->stage = Stage::kCommit;  // so that a fault leaves the outcome open
  std::vector<bool> stands;
  for (std::size_t k = 0; k < shards_.size(); ++k) {
    const bool behind = versions[k] + 1 == newest && positions[k].trial_stands;
    if (behind) {
      ask(k, wire::Commit{});
      versions[k] = newest;
    }
    stands.push_back(positions[k].trial_stands && !behind);
  }
  trial_stands_ = std::ranges::find(stands, true) != stands.end();
  if (!agree(versions)) return;
  post_all();
  settle();
  if (trial_stands_ && std::ranges::find(stands, false) != stands.end()) {
    trial_stands_ = false;
    for (std::size_t k = 0; k < shards_.size(); ++k)
      if (stands[k]) ask(k, wire::Rollback{});
    post_all();
    settle();
  }
  for (const Asked& asked : operation_->asked)
    if (asked.refusal) torn_ = fmt::format("the shards are not at the same step: {}", asked.refusal->what());
  state_version_ = newest;
  operation_.reset();
}

}  // namespace shearbus
