#include "client/src/sharded_session.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <exception>
#include <utility>
#include <variant>

#include "client/src/shards.hpp"
#include "proto/wire/codec.hpp"

namespace shearbus {
namespace {

void check_leaving(std::span<const std::uint64_t> leaving, std::span<const std::uint64_t> present) {
  std::vector<std::uint64_t> ids(leaving.begin(), leaving.end());
  std::vector<std::uint64_t> known(present.begin(), present.end());
  std::ranges::sort(ids);
  std::ranges::sort(known);
  if (const auto twice = std::ranges::adjacent_find(ids); twice != ids.end())
    refuse_call(Code::kDuplicateNode, fmt::format("node {} is given more than once", *twice), "Name each node once.",
                Field::kNodeId, {*twice});
  for (const std::uint64_t id : ids)
    if (!std::ranges::binary_search(known, id))
      refuse_call(Code::kUnknownNode, fmt::format("node {} is not of this session", id), "Name nodes of the session.",
                  Field::kNodeId, {id});
}

}  // namespace

void refuse_call(Code code, std::string text, std::string remedy, Field field, std::vector<std::uint64_t> node_ids) {
  throw Error({.code = code,
               .text = std::move(text),
               .remedy = std::move(remedy),
               .field = field == Field::kUnspecified ? "" : wire::name(field),
               .node_ids = std::move(node_ids)});
}

void ShardLinks::begin_call(std::chrono::milliseconds deadline) {
  deadline_ = deadline;
  started_.clear();
  for (const auto& shard : shards_) started_.push_back(shard->now());
}

std::chrono::milliseconds ShardLinks::left(std::uint32_t shard) const {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(started_[shard] + deadline_ - shards_[shard]->now());
  const auto time = std::max(left, std::chrono::milliseconds(1));
  shards_[shard]->set_reply_deadline(time);
  return time;
}

void try_post(Connection& connection, const wire::Request& request,
              void (Connection::*post)(const wire::Request&)) noexcept try {
  (connection.*post)(request);
} catch (const std::exception&) {
  // The call sends the request, and reports what is wrong.
}

std::vector<std::vector<std::uint32_t>> rows_of_shards(std::span<const std::uint64_t> node_ids, std::uint32_t shards) {
  std::vector<std::vector<std::uint32_t>> rows(shards);
  for (std::size_t row = 0; row < node_ids.size(); ++row)
    rows[shard_of(node_ids[row], shards)].push_back(static_cast<std::uint32_t>(row));
  return rows;
}

Batch rows_of(const Batch& batch, std::span<const std::uint32_t> rows) {
  if (batch.columns().empty()) return {};
  for (const wire::Column& column : batch.columns())
    if (column.count != batch.columns().front().count)
      refuse_call(Code::kShape,
                  fmt::format("{} has {} values and {} has {}", wire::name(column.field), column.count,
                              wire::name(batch.columns().front().field), batch.columns().front().count),
                  "Give every column one value per row.", column.field);
  Batch some = columns_of(batch, rows.size());
  for (const wire::Column& column : some.columns())
    if (!batch.has(column.field, column.component))
      refuse_call(Code::kShape, fmt::format("{} lacks its second component", wire::name(column.field)),
                  "Give every tangential column both components.", column.field);
  each_column(batch, some, [&](const wire::Column&, auto from, auto to) {
    for (std::size_t i = 0; i < rows.size(); ++i) to[i] = from[rows[i]];
  });
  return some;
}

ShardedSession::ShardedSession(ShardLinks& links, std::vector<std::unique_ptr<SessionState>> shards,
                               std::vector<std::uint64_t> node_ids)
    : links_(links), shards_(shards.size()) {
  for (std::size_t k = 0; k < shards.size(); ++k) {
    shards_[k].session = std::move(shards[k]);
    last_sequence_ = std::max(last_sequence_, shards_[k].session->last_sequence);
  }
  if (node_ids.empty()) node_ids = merged();
  place(std::make_shared<const Ids>(std::move(node_ids)));
}

// ---- one request ----

Received ShardedSession::call(const wire::Request& request) {
  const std::uint64_t hash = hash_of(request);
  if (operation_ && operation_->hash != hash) {
    const std::uint64_t sequence = operation_->sequence;
    bool has_run = true;
    try {
      complete();
    } catch (const Error&) {
      if (operation_) throw;
      has_run = false;
    }
    if (has_run)
      throw Error({.code = Code::kSequenceReused,
                   .text = fmt::format("request {}, whose outcome was unknown, has run on all shards", sequence),
                   .remedy = "After an unknown outcome make the same call again.",
                   .last_sequence = last_sequence_});
  }
  if (!operation_ && ahead_ && ahead_->operation.hash != hash) settle_ahead();
  if (previous_committed_ && asks<wire::Commit>(request)) {
    previous_committed_ = false;
    last_sequence_ = request.sequence;
    Received received;
    received.reply.body = wire::Committed{.state_version = state_version_};
    return received;
  }
  if (!operation_) begin(request, hash);
  return complete();
}

void ShardedSession::post(const wire::Request& request) {
  if (operation_) return;  // call() goes on with it
  const std::uint64_t hash = hash_of(request);
  if (ahead_ && ahead_->operation.hash != hash) return;  // call() settles it first
  begin(request, hash);
}

void ShardedSession::post_behind(const wire::Request& request) {
  const auto& step = std::get<wire::Downscale>(request.body);
  if (ahead_ && !operation_ && step.follows == ahead_->operation.hash) begin_ahead();  // its call comes next
  // After a fault the part before, or this one, may be under way already.
  if (ahead_ || !operation_ || operation_->stage != Stage::kAsked || step.follows != operation_->hash) return;
  Ahead ahead;
  ahead.operation = {.hash = hash_of(request),
                     .sequence = request.sequence,
                     .rows = request.batch.columns().front().count,
                     .named = request.batch.has(Field::kNodeId)};
  ahead.operation.question.body = request.body;
  if (ahead.operation.named) ahead.named_rows = rows_of_shards(request.batch.u64(Field::kNodeId), links_.size());
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    const Shard& shard = shards_[k];
    wire::Request part = shard.session->next_request();
    part.sequence = shard.request.sequence + 1;
    part.epoch = shard.request.epoch;
    part.request_id = shard.session->connection->next_request_id();
    auto& asked = part.body.emplace<wire::Downscale>(step);
    asked.mode = wire::Mode::kTrial;
    asked.follows = hash_of(shard.request);
    part.batch = rows_of(request.batch, ahead.operation.named ? ahead.named_rows[k] : shard.rows);
    ahead.requests.push_back(std::move(part));
  }
  ahead_ = std::move(ahead);
  for (std::uint32_t k = 0; k < links_.size(); ++k)
    try_post(*shards_[k].session->connection, ahead_->requests[k], &Connection::post_behind);
}

// Makes the part that was sent ahead the operation under way. A shard that was restarted since has lost it: it gets
// the part anew, behind the answered one.
void ShardedSession::begin_ahead() {
  Ahead ahead = std::move(*ahead_);
  ahead_.reset();
  operation_ = std::move(ahead.operation);
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    Shard& shard = shards_[k];
    shard.reply.reset();
    shard.answer.reset();
    shard.refusal.reset();
    if (operation_->named) shard.named_rows = std::move(ahead.named_rows[k]);
    shard.request = std::move(ahead.requests[k]);
    shard.open = true;
    if (shard.request.epoch == shard.session->epoch) continue;
    shard.request.epoch = shard.session->epoch;
    shard.request.request_id = shard.session->connection->next_request_id();
    std::get<wire::Downscale>(shard.request.body).follows = 0;
  }
}

// Ends a part that was sent ahead and will not be called: the shards may have run it. Its answers are of no use, and
// it commits nothing.
void ShardedSession::settle_ahead() {
  begin_ahead();
  ++operation_->hash;  // it is nobody's request any more
  std::get<wire::Downscale>(operation_->question.body).mode = wire::Mode::kTrial;
  try {
    complete();
  } catch (const Error&) {
    if (operation_) throw;
  }
}

void ShardedSession::begin(const wire::Request& request, std::uint64_t hash) {
  if (ahead_) return begin_ahead();  // of the same hash: call() and post() have settled any other
  const auto* rollback = std::get_if<wire::Rollback>(&request.body);
  const bool to_mark = rollback != nullptr && !rollback->to_mark.empty();
  if (!torn_.empty() && !to_mark)
    refuse_call(Code::kEpoch, torn_,
                "Roll back to a mark that all shards have, or start again from the host's restart point.");
  for (Shard& shard : shards_) {
    shard.open = false;
    shard.reply.reset();
    shard.answer.reset();
    shard.refusal.reset();
  }
  try {
    operation_ = Operation{};
    Operation& operation = *operation_;
    operation.hash = hash;
    operation.sequence = request.sequence;
    operation.question.body = request.body;
    const bool leaving = asks<wire::RetireNodes, wire::OfferNodes>(request);
    if (const auto* step = std::get_if<wire::Downscale>(&request.body)) {
      begin_step(request, *step);
    } else if (leaving || asks<wire::RegisterNodes>(request)) {
      begin_nodes(request, leaving);
    } else if (to_mark && trial_stands_) {
      // First the trials, so that after a crash of this client none of them is taken for a step to be committed.
      operation.stage = Stage::kDropTrial;
      ask_all(wire::Rollback{});
    } else if (asks<wire::Commit, wire::Rollback, wire::Mark, wire::AcceptNodes>(request)) {
      ask_all(request.body);
    } else {
      refuse_call(Code::kUnsupported, fmt::format("{} is not a request to several servers", verb_of(request)),
                  "Ask each server by an endpoint of its own.");
    }
  } catch (...) {
    operation_.reset();
    throw;
  }
  post_all();
}

void ShardedSession::begin_step(const wire::Request& request, const wire::Downscale& step) {
  Operation& operation = *operation_;
  const auto& columns = request.batch.columns();
  operation.rows = columns.empty() ? 0 : columns.front().count;
  operation.named = request.batch.has(Field::kNodeId);
  if (!operation.named && operation.rows != node_ids_->size())
    refuse_call(Code::kShape, fmt::format("{} rows for {} nodes", operation.rows, node_ids_->size()),
                "Give one row per node, or name the node of each row.",
                columns.empty() ? Field::kNodeId : columns[0].field);
  wire::Downscale asked = step;
  asked.mode = wire::Mode::kTrial;
  asked.follows = 0;  // all shards have answered the part before
  asked.commit_previous = operation.commits_previous = step.commit_previous && !previous_committed_;
  if (operation.named) {
    auto rows = rows_of_shards(request.batch.u64(Field::kNodeId), links_.size());
    for (std::uint32_t k = 0; k < links_.size(); ++k) shards_[k].named_rows = std::move(rows[k]);
  }
  // A shard without rows takes part, too, so that all shards count the same steps.
  for (Shard& shard : shards_) ask(shard, asked, rows_of(request.batch, rows_in(shard)));
}

void ShardedSession::begin_nodes(const wire::Request& request, bool leaving) {
  const auto ids = request.batch.u64(Field::kNodeId);
  if (leaving && trial_stands_)
    refuse_call(Code::kTrialStands, "a trial stands, and the set of nodes cannot change",
                "Commit it or roll it back first.");
  if (leaving)
    check_leaving(ids, *node_ids_);
  else
    operation_->question.batch = named_nodes(ids);
  const auto rows = rows_of_shards(ids, links_.size());
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    if (rows[k].empty() && !(ids.empty() && k == 0)) continue;  // the first shard refuses a request without nodes
    ask(shards_[k], request.body, rows_of(request.batch, rows[k]));
  }
}

void ShardedSession::ask(Shard& shard, Body body, Batch batch) {
  shard.request = shard.session->next_request();
  if (shard.request.request_id == 0) shard.request.request_id = shard.session->connection->next_request_id();
  shard.request.body = std::move(body);
  shard.request.batch = std::move(batch);
  shard.open = true;
  shard.reply.reset();
  shard.refusal.reset();
}

void ShardedSession::ask_all(const Body& body) {
  for (Shard& shard : shards_) ask(shard, body);
}

void ShardedSession::post_all() {
  for (Shard& shard : shards_)
    if (shard.open) try_post(*shard.session->connection, shard.request);
}

}  // namespace shearbus
