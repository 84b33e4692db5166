#include "client/src/sharded_session.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <iterator>
#include <utility>
#include <variant>

#include "client/src/shards.hpp"
#include "proto/wire/text.hpp"

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

void refuse_verb(const wire::Request& request) {
  refuse_call(Code::kUnsupported, fmt::format("{} is not a request to several servers", verb_of(request)),
              "Ask each server by an endpoint of its own.");
}

void ShardLinks::begin_call(std::chrono::milliseconds deadline) {
  deadline_ = deadline;
  started_.clear();
  for (const auto& shard : shards_) started_.push_back(shard->now());
}

std::chrono::milliseconds ShardLinks::left(std::uint32_t shard) const {
  shards_[shard]->set_reply_deadline(deadline_);
  shards_[shard]->set_reply_deadline(shards_[shard]->left_since(started_[shard]));
  return shards_[shard]->options().reply_deadline;
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
  if (!operation_ && ahead_ && ahead_->hash != hash) settle_ahead();
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
  if (ahead_ && ahead_->hash != hash) return;  // call() settles it first
  begin(request, hash);
}

void ShardedSession::post_behind(const wire::Request& request) {
  const auto& step = std::get<wire::Downscale>(request.body);
  if (ahead_ && !operation_ && step.follows == ahead_->hash) begin_ahead();  // its call comes next
  // After a fault the part before, or this one, may be under way already.
  if (ahead_ || !operation_ || operation_->stage != Stage::kAsked || step.follows != operation_->hash) return;
  Operation ahead = operation_of(request, hash_of(request));
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    const wire::Request& before = operation_->asked[k].request;
    wire::Request& behind = ahead.asked[k].request;
    behind = shards_[k].session->next_request();
    behind.sequence = before.sequence + 1;
    behind.epoch = before.epoch;
    behind.request_id = links_[k]->next_request_id();
    auto& part = behind.body.emplace<wire::Downscale>(step);
    part.mode = wire::Mode::kTrial;
    part.follows = hash_of(before);
    behind.batch = rows_of(request.batch, rows_in(ahead, k));
    ahead.asked[k].open = true;
  }
  ahead_ = std::move(ahead);
  for (std::uint32_t k = 0; k < links_.size(); ++k)
    try_post(*links_[k], ahead_->asked[k].request, &Connection::post_behind);
}

// Makes the part that was sent ahead the operation under way. A shard that was restarted since has lost it: it gets
// the part anew, behind the answered one.
void ShardedSession::begin_ahead() {
  operation_ = std::exchange(ahead_, std::nullopt);
  for (std::size_t k = 0; k < shards_.size(); ++k) {
    wire::Request& request = operation_->asked[k].request;
    SessionState& session = *shards_[k].session;
    if (request.epoch == session.epoch) continue;
    request.epoch = session.epoch;
    request.request_id = session.connection->next_request_id();
    std::get<wire::Downscale>(request.body).follows = 0;
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
  if (!torn_.empty() && !to_mark) refuse_torn();
  try {
    operation_ = operation_of(request, hash);
    const bool leaving = asks<wire::RetireNodes, wire::OfferNodes>(request);
    if (const auto* step = std::get_if<wire::Downscale>(&request.body)) {
      begin_step(request, *step);
    } else if (const auto* opening = std::get_if<wire::OpenSession>(&request.body)) {
      begin_opening(request, *opening);
    } else if (leaving || asks<wire::RegisterNodes>(request)) {
      begin_nodes(request, leaving);
    } else if (to_mark && trial_stands_) {
      // First the trials, so that after a crash of this client none of them is taken for a step to be committed.
      operation_->stage = Stage::kDropTrial;
      ask_all(wire::Rollback{});
    } else if (to_mark) {
      ask_to_roll_back(*rollback);
    } else if (asks<wire::Commit, wire::Rollback, wire::Mark, wire::AcceptNodes>(request)) {
      ask_all(request.body);
    } else {
      refuse_verb(request);
    }
  } catch (...) {
    operation_.reset();
    throw;
  }
  post_all();
}

// Opens a session on each shard, also on one without nodes, under the id and domain by which the shard knows it.
void ShardedSession::begin_opening(const wire::Request& request, const wire::OpenSession& opening) {
  if (opening.domain.empty() && node_ids_->empty())
    refuse_call(Code::kShape, "a session without a domain needs at least one node; none was given",
                "Give nodes, or a domain.", Field::kNodeId);
  const std::string domain =
      opening.domain.empty() ? "session " + wire::hexadecimal(opening.session_id) : opening.domain;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    Asked& asked = operation_->asked[k];
    wire::OpenSession of_shard = opening;
    of_shard.session_id = shards_[k].session->id;
    of_shard.domain = domain_of_shard(domain, k, links_.size());
    ask(k, std::move(of_shard), asked.named_rows.empty() ? Batch() : rows_of(request.batch, asked.named_rows));
    asked.request.session_id = {};  // there is none yet
    asked.request.sequence = 0;
  }
}

void ShardedSession::begin_step(const wire::Request& request, const wire::Downscale& step) {
  const auto& columns = request.batch.columns();
  if (!operation_->named && operation_->rows != node_ids_->size())
    refuse_call(Code::kShape, fmt::format("{} rows for {} nodes", operation_->rows, node_ids_->size()),
                "Give one row per node, or name the node of each row.",
                columns.empty() ? Field::kNodeId : columns[0].field);
  wire::Downscale asked = step;
  asked.mode = wire::Mode::kTrial;
  asked.follows = 0;  // all shards have answered the part before
  asked.commit_previous = operation_->commits_previous = step.commit_previous && !previous_committed_;
  // A shard without rows takes part, too, so that all shards count the same steps.
  for (std::size_t k = 0; k < shards_.size(); ++k) ask(k, asked, rows_of(request.batch, rows_in(*operation_, k)));
}

// Asks first the shards to which the mark would bring nodes back: these alone can refuse it, where another session has
// the nodes. The others go back once these have.
void ShardedSession::ask_to_roll_back(const wire::Rollback& rollback) {
  Ids returning;
  if (const auto mark = marks_.find(rollback.to_mark); mark != marks_.end()) {
    Ids then = *mark->second;
    Ids now = *node_ids_;
    std::ranges::sort(then);
    std::ranges::sort(now);
    std::ranges::set_difference(then, now, std::back_inserter(returning));
  }
  if (returning.empty()) return ask_all(rollback);
  for (Asked& asked : operation_->asked) asked.reply.reset();  // to what came before
  const auto rows = rows_of_shards(returning, links_.size());
  for (std::size_t k = 0; k < shards_.size(); ++k)
    if (!rows[k].empty()) ask(k, rollback);
}

void ShardedSession::begin_nodes(const wire::Request& request, bool leaving) {
  const auto ids = request.batch.u64(Field::kNodeId);
  if (leaving && trial_stands_)
    refuse_call(Code::kTrialStands, "a trial stands, and the set of nodes cannot change",
                "Commit it or roll it back first.");
  if (leaving) check_leaving(ids, *node_ids_);
  operation_->question.batch = named_nodes(ids);
  for (std::size_t k = 0; k < shards_.size(); ++k) {
    const auto& rows = operation_->asked[k].named_rows;
    if (rows.empty() && !(ids.empty() && k == 0)) continue;  // the first shard refuses a request without nodes
    ask(k, request.body, rows_of(request.batch, rows));
  }
}

// ---- the requests to the shards ----

ShardedSession::Operation ShardedSession::operation_of(const wire::Request& request, std::uint64_t hash) const {
  const auto& columns = request.batch.columns();
  Operation operation{.hash = hash,
                      .sequence = request.sequence,
                      .question = {.body = request.body},
                      .rows = columns.empty() ? 0 : columns.front().count,
                      .named = request.batch.has(Field::kNodeId),
                      .asked = std::vector<Asked>(shards_.size())};
  auto rows = rows_of_shards(request.batch.u64(Field::kNodeId), links_.size());
  for (std::size_t k = 0; k < shards_.size(); ++k) operation.asked[k].named_rows = std::move(rows[k]);
  return operation;
}

void ShardedSession::ask(std::size_t shard, Body body, Batch batch) {
  Asked& asked = operation_->asked[shard];
  SessionState& session = *shards_[shard].session;
  asked.request = session.next_request();
  if (asked.request.request_id == 0) asked.request.request_id = session.connection->next_request_id();
  asked.request.body = std::move(body);
  asked.request.batch = std::move(batch);
  asked.open = true;
  asked.reply.reset();
  asked.refusal.reset();
}

void ShardedSession::ask_all(const Body& body) {
  for (std::size_t k = 0; k < shards_.size(); ++k) ask(k, body);
}

void ShardedSession::post_all() {
  for (std::uint32_t k = 0; k < links_.size(); ++k)
    if (operation_->asked[k].open) try_post(*links_[k], operation_->asked[k].request);
}

// ---- the end of the session ----

Received ShardedSession::close(const wire::Request& request) {
  operation_.reset();
  ahead_.reset();
  std::optional<Error> fault;
  wire::SessionClosed totals;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    Shard& shard = shards_[k];
    for (int attempt = 0; !shard.closed && attempt < 2; ++attempt) {
      links_.left(k);
      try {
        shard.closed = shard.session->exchange<wire::SessionClosed>(std::get<wire::CloseSession>(request.body));
      } catch (const Error& refusal) {
        // A request that was interrupted has run: the session stands behind it now.
        if (refusal.status().code == Code::kSequenceReused && attempt == 0) continue;
        if (!fault) fault = refusal;
        break;
      }
    }
    if (!shard.closed) continue;
    totals.requests += shard.closed->requests;
    totals.node_steps += shard.closed->node_steps;
    totals.solver_ns += shard.closed->solver_ns;
    totals.asleep_node_steps += shard.closed->asleep_node_steps;
  }
  if (fault) throw Error(*fault);
  Received received;
  received.reply.body = totals;
  return received;
}

void ShardedSession::say_close(const wire::Request& request) noexcept try {
  for (std::size_t k = 0; k < shards_.size(); ++k) {
    if (shards_[k].closed) continue;
    SessionState& session = *shards_[k].session;
    wire::Request goodbye = session.next_request();
    if (operation_ && operation_->asked[k].open)
      ++goodbye.sequence;  // the request under way runs before the closing one
    if (ahead_) ++goodbye.sequence;
    if (goodbye.request_id == 0) goodbye.request_id = session.connection->next_request_id();
    goodbye.body = request.body;
    session.connection->say(goodbye);
  }
} catch (const std::exception&) {
  // Without memory for the closing request the sessions stay open on the servers.
}

}  // namespace shearbus
