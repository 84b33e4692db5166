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
bool is_refusal(Code code) {
  switch (code) {
    case Code::kNothingToCommit:
    case Code::kUnknownMark:
    case Code::kTrialStands:
    case Code::kUnknownTransfer:
    case Code::kNotPermitted:
      return true;
    default:
      return static_cast<int>(code) / 100 == 1 || static_cast<int>(code) / 100 == 3;
  }
}

}  // namespace

// Waits for the answers of all shards. Throws the first fault that leaves the outcome on a shard open.
void ShardedSession::settle() {
  std::optional<Error> unsettled;
  bool may_have_run = operation_->stage != Stage::kAsked;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    Shard& shard = shards_[k];
    if (shard.open) {
      links_.left(k);
      try {
        shard.reply = shard.session->exchange(shard.request);
        shard.open = false;
      } catch (const Error& fault) {
        if (is_refusal(fault.status().code)) {
          shard.refusal = fault;
          shard.open = false;
        } else {
          may_have_run |= shard.session->in_doubt.has_value();
          if (!unsettled) unsettled = fault;
        }
      }
    }
    may_have_run |= shard.reply.has_value();
  }
  if (!unsettled) return;
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
  const auto is_refused = [](const Shard& shard) { return shard.refusal.has_value(); };
  const bool refused = std::ranges::any_of(shards_, is_refused);
  const bool ran = std::ranges::any_of(shards_, [](const Shard& shard) { return shard.reply.has_value(); });
  const auto* step = std::get_if<wire::Downscale>(&operation.question.body);
  const auto torn = [&](const char* what) {
    const auto at = std::ranges::find_if(shards_, is_refused);
    torn_ = fmt::format("the shards are not at the same step: {} on shard {}: {}", what, at - shards_.begin(),
                        describe(at->refusal->status()));
  };
  switch (operation.stage) {
    case Stage::kDropTrial:
      trial_stands_ = false;
      operation.stage = Stage::kAsked;
      ask_all(std::get<wire::Rollback>(operation.question.body));
      break;
    case Stage::kAsked: {
      if (!refused) {
        if (step == nullptr || step->mode != wire::Mode::kAdvance || !last_of_step(*step)) return false;
        for (Shard& shard : shards_) shard.answer = std::move(shard.reply);
        operation.stage = Stage::kCommit;
        ask_all(wire::Commit{});
        break;
      }
      const bool accepts = asks<wire::AcceptNodes>(operation.question);
      const auto holds_no_offer = [](const Shard& shard) {
        return shard.refusal && shard.refusal->status().code == Code::kUnknownTransfer;
      };
      const bool only_without_offer =
          std::ranges::all_of(shards_, [&](const Shard& shard) { return !shard.refusal || holds_no_offer(shard); });
      if (accepts && ran && only_without_offer) return false;
      const auto first = std::ranges::find_if(
          shards_, [&](const Shard& shard) { return shard.refusal && (only_without_offer || !holds_no_offer(shard)); });
      wire::Status status = first->refusal->status();
      for (auto shard = first + 1; shard != shards_.end(); ++shard)
        if (shard->refusal && shard->refusal->status().code == status.code)
          status.node_ids.insert(status.node_ids.end(), shard->refusal->status().node_ids.begin(),
                                 shard->refusal->status().node_ids.end());
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
      for (Shard& shard : shards_)
        if (std::exchange(shard.ran_part, false)) shard.refusal.reset();
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
      if (!refused && step != nullptr) state_version_ = body_of<wire::RolledBack>(*shards_.front().reply).state_version;
      return false;
  }
  post_all();
  return true;
}

// Of a part that some shards have refused: the others may run the part behind it, whose answers are awaited first.
void ShardedSession::drain() {
  Ahead ahead = std::move(*ahead_);
  ahead_.reset();
  operation_->stage = Stage::kDrain;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    Shard& shard = shards_[k];
    if (!shard.reply || ahead.requests[k].epoch != shard.session->epoch) continue;  // a restarted shard has lost it
    shard.reply.reset();
    shard.ran_part = shard.open = true;
    shard.request = std::move(ahead.requests[k]);
  }
}

// After a refusal by some shards: those commit the trial before, if the others have, and all go back.
void ShardedSession::undo() {
  Operation& operation = *operation_;
  if (!asks<wire::Downscale>(operation.question) || !operation.commits_previous) return go_back();
  operation.stage = Stage::kCommitPrevious;
  for (Shard& shard : shards_)
    if (shard.refusal) ask(shard, wire::Commit{});
}

// Undoes a request on the shards that have run it, since others have refused it.
void ShardedSession::go_back() {
  Operation& operation = *operation_;
  operation.stage = Stage::kUndo;
  for (Shard& shard : shards_) shard.refusal.reset();
  if (asks<wire::Downscale>(operation.question)) {
    trial_stands_ = false;
    return ask_all(wire::Rollback{});
  }
  for (Shard& shard : shards_) {
    if (!shard.reply) continue;
    if (asks<wire::RegisterNodes>(shard.request)) {
      ask(shard, wire::RetireNodes{}, named_nodes(shard.request.batch.u64(Field::kNodeId)));
    } else if (const auto* offer = std::get_if<wire::OfferNodes>(&shard.request.body)) {
      ask(shard, wire::AcceptNodes{.transfer_id = offer->transfer_id});
    } else if (const auto* accept = std::get_if<wire::AcceptNodes>(&shard.request.body)) {
      ask(shard, wire::OfferNodes{.transfer_id = accept->transfer_id},
          named_nodes(std::as_const(shard.reply->reply.batch).u64(Field::kNodeId)));
    }
  }
}

}  // namespace shearbus
