#include "client/src/sharded_session.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <exception>
#include <utility>
#include <variant>

#include "client/src/shards.hpp"
#include "proto/wire/codec.hpp"

namespace shearbus {
namespace {

[[noreturn]] void refuse(Code code, std::string text, std::string remedy, Field field = Field::kUnspecified,
                         std::vector<std::uint64_t> node_ids = {}) {
  throw Error({.code = code,
               .text = std::move(text),
               .remedy = std::move(remedy),
               .field = field == Field::kUnspecified ? "" : wire::name(field),
               .node_ids = std::move(node_ids)});
}

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

bool last_of_step(const wire::Downscale& step) {
  return step.part == step.parts;
}

bool all_equal(std::span<const std::uint64_t> values) {
  return std::ranges::all_of(values, [&](std::uint64_t value) { return value == values.front(); });
}

// Joins lists of ids: takes the least of their first ids, again and again. Lists in ascending order give one.
std::vector<std::uint64_t> merge_of(std::vector<std::span<const std::uint64_t>> lists) {
  std::vector<std::uint64_t> all;
  for (;;) {
    std::span<const std::uint64_t>* least = nullptr;
    for (auto& list : lists)
      if (!list.empty() && (least == nullptr || list.front() < least->front())) least = &list;
    if (least == nullptr) return all;
    all.push_back(least->front());
    *least = least->subspan(1);
  }
}

void check_leaving(std::span<const std::uint64_t> leaving, std::span<const std::uint64_t> present) {
  std::vector<std::uint64_t> ids(leaving.begin(), leaving.end());
  std::vector<std::uint64_t> known(present.begin(), present.end());
  std::ranges::sort(ids);
  std::ranges::sort(known);
  if (const auto twice = std::ranges::adjacent_find(ids); twice != ids.end())
    refuse(Code::kDuplicateNode, fmt::format("node {} is given more than once", *twice), "Name each node once.",
           Field::kNodeId, {*twice});
  for (const std::uint64_t id : ids)
    if (!std::ranges::binary_search(known, id))
      refuse(Code::kUnknownNode, fmt::format("node {} is not of this session", id), "Name nodes of the session.",
             Field::kNodeId, {id});
}

}  // namespace

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

void try_post(Connection& connection, const wire::Request& request) noexcept try {
  connection.post(request);
} catch (const std::exception&) {
  // The call sends the request, and reports what is wrong.
}

void try_post_behind(Connection& connection, const wire::Request& request) noexcept try {
  connection.post_behind(request);
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
  std::vector<Field> fields;
  std::uint32_t components = 1;
  for (const wire::Column& column : batch.columns()) {
    if (column.count != batch.columns().front().count)
      refuse(Code::kShape,
             fmt::format("{} has {} values and {} has {}", wire::name(column.field), column.count,
                         wire::name(batch.columns().front().field), batch.columns().front().count),
             "Give every column one value per row.", column.field);
    if (column.component == 0) fields.push_back(column.field);
    components = std::max(components, column.component + 1);
  }
  Batch some = Batch::of(fields, rows.size(), components);
  for (const wire::Column& column : some.columns()) {
    if (!batch.has(column.field, column.component))
      refuse(Code::kShape, fmt::format("{} lacks its second component", wire::name(column.field)),
             "Give every tangential column both components.", column.field);
    const auto copy = [&](auto from, auto to) {
      for (std::size_t i = 0; i < rows.size(); ++i) to[i] = from[rows[i]];
    };
    if (column.element == wire::Element::kUint64)
      copy(batch.u64(column.field), some.u64(column.field));
    else
      copy(batch.f64(column.field, column.component), some.f64(column.field, column.component));
  }
  return some;
}

ShardedSession::ShardedSession(ShardLinks& links, std::vector<std::unique_ptr<Session::Impl>> shards,
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
  const std::string header = wire::encode_header(request);  // holds the checksum of the payload
  const std::array<std::span<const std::byte>, 1> bytes = {std::as_bytes(std::span(header))};
  const std::uint64_t hash = wire::hash_of(bytes);
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
  if (previous_committed_ && std::holds_alternative<wire::Commit>(request.body)) {
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
  const std::string header = wire::encode_header(request);
  const std::array<std::span<const std::byte>, 1> bytes = {std::as_bytes(std::span(header))};
  const std::uint64_t hash = wire::hash_of(bytes);
  if (ahead_ && ahead_->operation.hash != hash) return;  // call() settles it first
  begin(request, hash);
}

void ShardedSession::post_behind(const wire::Request& request) {
  const auto& step = std::get<wire::Downscale>(request.body);
  if (ahead_ && !operation_ && step.follows == ahead_->operation.hash) begin_ahead();  // its call comes next
  // After a fault the part before, or this one, may be under way already.
  if (ahead_ || !operation_ || operation_->stage != Stage::kAsked || step.follows != operation_->hash) return;
  const std::string header = wire::encode_header(request);
  const std::array<std::span<const std::byte>, 1> bytes = {std::as_bytes(std::span(header))};
  Ahead ahead;
  ahead.operation = {.hash = wire::hash_of(bytes),
                     .sequence = request.sequence,
                     .rows = request.batch.columns().front().count,
                     .named = request.batch.has(Field::kNodeId)};
  ahead.operation.question.body = request.body;
  if (ahead.operation.named) ahead.named_rows = rows_of_shards(request.batch.u64(Field::kNodeId), links_.size());
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    const Shard& shard = shards_[k];
    const std::string before = wire::encode_header(shard.request);
    const std::array<std::span<const std::byte>, 1> bytes_before = {std::as_bytes(std::span(before))};
    wire::Request part = shard.session->next_request();
    part.sequence = shard.request.sequence + 1;
    part.epoch = shard.request.epoch;
    part.request_id = shard.session->connection->next_request_id();
    auto& asked = part.body.emplace<wire::Downscale>(step);
    asked.mode = wire::Mode::kTrial;
    asked.follows = wire::hash_of(bytes_before);
    part.batch = rows_of(request.batch, ahead.operation.named ? ahead.named_rows[k] : shard.rows);
    ahead.requests.push_back(std::move(part));
  }
  ahead_ = std::move(ahead);
  for (std::uint32_t k = 0; k < links_.size(); ++k)
    try_post_behind(*shards_[k].session->connection, ahead_->requests[k]);
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
    refuse(Code::kEpoch, torn_,
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
    if (const auto* step = std::get_if<wire::Downscale>(&request.body)) {
      begin_step(request, *step);
    } else if (std::holds_alternative<wire::RegisterNodes>(request.body)) {
      begin_nodes(request, false);
    } else if (std::holds_alternative<wire::RetireNodes>(request.body) ||
               std::holds_alternative<wire::OfferNodes>(request.body)) {
      begin_nodes(request, true);
    } else if (to_mark && trial_stands_) {
      // First the trials, so that after a crash of this client none of them is taken for a step to be committed.
      operation.stage = Stage::kDropTrial;
      ask_all(wire::Rollback{});
    } else if (const auto* commit = std::get_if<wire::Commit>(&request.body)) {
      ask_all(*commit);
    } else if (rollback != nullptr) {
      ask_all(*rollback);
    } else if (const auto* mark = std::get_if<wire::Mark>(&request.body)) {
      ask_all(*mark);
    } else if (const auto* accept = std::get_if<wire::AcceptNodes>(&request.body)) {
      ask_all(*accept);
    } else {
      refuse(Code::kUnsupported, fmt::format("{} is not a request to several servers", verb_of(request)),
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
    refuse(Code::kShape, fmt::format("{} rows for {} nodes", operation.rows, node_ids_->size()),
           "Give one row per node, or name the node of each row.", columns.empty() ? Field::kNodeId : columns[0].field);
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
    refuse(Code::kTrialStands, "a trial stands, and the set of nodes cannot change",
           "Commit it or roll it back first.");
  if (leaving)
    check_leaving(ids, *node_ids_);
  else
    operation_->question.batch = named_nodes(ids);
  const auto rows = rows_of_shards(ids, links_.size());
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    if (rows[k].empty() && !(ids.empty() && k == 0)) continue;  // the first shard refuses a request without nodes
    Shard& shard = shards_[k];
    std::visit(
        [&](const auto& body) {
          if constexpr (!std::is_same_v<std::remove_cvref_t<decltype(body)>, std::monostate>)
            ask(shard, body, rows_of(request.batch, rows[k]));
        },
        request.body);
  }
}

template <typename Body>
void ShardedSession::ask(Shard& shard, Body body, Batch batch) {
  wire::Request request = shard.session->next_request();
  if (request.request_id == 0) request.request_id = shard.session->connection->next_request_id();
  request.body = std::move(body);
  request.batch = std::move(batch);
  shard.request = std::move(request);
  shard.open = true;
  shard.reply.reset();
  shard.refusal.reset();
}

template <typename Body>
void ShardedSession::ask_all(const Body& body) {
  for (Shard& shard : shards_) ask(shard, body);
}

void ShardedSession::post_all() {
  for (Shard& shard : shards_)
    if (shard.open) try_post(*shard.session->connection, shard.request);
}

// Waits for the answers of all shards. Throws the first fault that leaves the outcome on a shard open.
void ShardedSession::settle() {
  std::optional<Error> unsettled;
  bool may_have_run = operation_->stage != Stage::kAsked;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    Shard& shard = shards_[k];
    if (shard.open) {
      links_.left(k);
      try {
        shard.reply = shard.session->send(shard.request,
                                          [&](Received& received) { adopt(*shard.session, shard.request, received); });
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

// Takes over the nodes that a shard has after a request.
void ShardedSession::adopt(Session::Impl& session, const wire::Request& request, Received& received) const {
  const auto append = [&](std::span<const std::uint64_t> ids) {
    session.node_ids.insert(session.node_ids.end(), ids.begin(), ids.end());
  };
  const auto named = request.batch.u64(Field::kNodeId);
  const auto answered = std::as_const(received.reply.batch).u64(Field::kNodeId);
  if (std::holds_alternative<wire::RegisterNodes>(request.body)) {
    body_of<wire::NodesChanged>(received);
    append(named);
  } else if (std::holds_alternative<wire::RetireNodes>(request.body) ||
             std::holds_alternative<wire::OfferNodes>(request.body)) {
    body_of<wire::NodesChanged>(received);
    session.remove_nodes(named);
  } else if (std::holds_alternative<wire::AcceptNodes>(request.body)) {
    body_of<wire::NodesChanged>(received);
    append(answered);
  } else if (const auto* rollback = std::get_if<wire::Rollback>(&request.body)) {
    body_of<wire::RolledBack>(received);
    if (!rollback->to_mark.empty()) session.node_ids.assign(answered.begin(), answered.end());
  } else if (std::holds_alternative<wire::Downscale>(request.body)) {
    body_of<wire::Upscale>(received);
  } else if (std::holds_alternative<wire::Commit>(request.body)) {
    body_of<wire::Committed>(received);
  } else {
    body_of<wire::Marked>(received);
  }
}

// ---- the operation under way ----

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
      const bool accepts = std::holds_alternative<wire::AcceptNodes>(operation.question.body);
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
      if (std::holds_alternative<wire::Rollback>(operation.question.body)) {
        torn("the rollback to a mark is refused");
        return false;
      }
      if (std::holds_alternative<wire::Commit>(operation.question.body)) {
        torn("the commit is refused");
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
  if (!std::holds_alternative<wire::Downscale>(operation.question.body) || !operation.commits_previous)
    return go_back();
  operation.stage = Stage::kCommitPrevious;
  for (Shard& shard : shards_)
    if (shard.refusal) ask(shard, wire::Commit{});
}

// Undoes a request on the shards that have run it, since others have refused it.
void ShardedSession::go_back() {
  Operation& operation = *operation_;
  operation.stage = Stage::kUndo;
  for (Shard& shard : shards_) shard.refusal.reset();
  if (std::holds_alternative<wire::Downscale>(operation.question.body)) {
    trial_stands_ = false;
    return ask_all(wire::Rollback{});
  }
  for (Shard& shard : shards_) {
    if (!shard.reply) continue;
    if (std::holds_alternative<wire::RegisterNodes>(shard.request.body)) {
      ask(shard, wire::RetireNodes{}, named_nodes(shard.request.batch.u64(Field::kNodeId)));
    } else if (const auto* offer = std::get_if<wire::OfferNodes>(&shard.request.body)) {
      ask(shard, wire::AcceptNodes{.transfer_id = offer->transfer_id});
    } else if (const auto* accept = std::get_if<wire::AcceptNodes>(&shard.request.body)) {
      ask(shard, wire::OfferNodes{.transfer_id = accept->transfer_id},
          named_nodes(std::as_const(shard.reply->reply.batch).u64(Field::kNodeId)));
    }
  }
}

// ---- joining the replies ----

std::uint64_t ShardedSession::same_version(std::span<const std::uint64_t> versions) {
  if (!all_equal(versions)) {
    torn_ = fmt::format("the shards are not at the same step: their state versions are {}", fmt::join(versions, ", "));
    operation_.reset();
    refuse(Code::kEpoch, torn_,
           "Roll back to a mark that all shards have, or start again from the host's restart point.");
  }
  return versions.front();
}

// The reply to a request that all its shards have run.
Received ShardedSession::join() {
  Operation& operation = *operation_;
  Received joined;
  std::vector<std::uint64_t> versions;
  std::shared_ptr<const Ids> order = node_ids_;
  for (const Shard& shard : shards_)
    if (shard.reply) joined.round_trip = std::max(joined.round_trip, shard.reply->round_trip);
  const auto versions_of = [&]<typename Body>(const Body* /*type*/) {
    for (Shard& shard : shards_) versions.push_back(body_of<Body>(*shard.reply).state_version);
  };
  wire::Request& question = operation.question;
  if (const auto* step = std::get_if<wire::Downscale>(&question.body)) {
    std::vector<Received*> replies;
    const bool committed = operation.stage == Stage::kCommit;
    for (Shard& shard : shards_) {
      replies.push_back(&(committed ? *shard.answer : *shard.reply));
      joined.round_trip = std::max(joined.round_trip, replies.back()->round_trip);
    }
    joined.reply.batch = join_rows(replies);
    wire::Upscale sum = join_steps(replies);
    if (committed)
      versions_of(static_cast<const wire::Committed*>(nullptr));
    else
      versions_of(static_cast<const wire::Upscale*>(nullptr));
    sum.state_version = same_version(versions);
    joined.reply.body = std::move(sum);
    trial_stands_ = !committed && last_of_step(*step);
    previous_committed_ = false;
  } else if (std::holds_alternative<wire::Commit>(question.body)) {
    versions_of(static_cast<const wire::Committed*>(nullptr));
    joined.reply.body = wire::Committed{.state_version = same_version(versions)};
    trial_stands_ = false;
  } else if (const auto* rollback = std::get_if<wire::Rollback>(&question.body)) {
    versions_of(static_cast<const wire::RolledBack*>(nullptr));
    const std::uint64_t version = same_version(versions);
    joined.reply.body = wire::RolledBack{.state_version = version};
    torn_.clear();
    trial_stands_ = previous_committed_ = false;
    if (!rollback->to_mark.empty()) {
      const auto mark = marks_.find(rollback->to_mark);
      if (mark == marks_.end() || !place(mark->second)) place(std::make_shared<const Ids>(merged()));
      joined.reply.batch = named_nodes(*node_ids_);
    }
  } else if (std::holds_alternative<wire::Mark>(question.body)) {
    versions_of(static_cast<const wire::Marked*>(nullptr));
    wire::Marked marked = body_of<wire::Marked>(*shards_.front().reply);
    for (Shard& shard : shards_)
      std::erase_if(marked.names, [&](const std::string& name) {
        const auto& others = body_of<wire::Marked>(*shard.reply).names;
        return std::ranges::find(others, name) == others.end();
      });
    marks_[std::get<wire::Mark>(question.body).name] = node_ids_;
    std::erase_if(marks_,
                  [&](const auto& mark) { return std::ranges::find(marked.names, mark.first) == marked.names.end(); });
    marked.state_version = same_version(versions);
    joined.reply.body = std::move(marked);
  } else {
    Ids now = *node_ids_;
    if (std::holds_alternative<wire::AcceptNodes>(question.body)) {
      std::vector<std::span<const std::uint64_t>> lists;
      for (Shard& shard : shards_)
        if (shard.reply) lists.push_back(std::as_const(shard.reply->reply.batch).u64(Field::kNodeId));
      const Ids accepted = merge_of(std::move(lists));
      now.insert(now.end(), accepted.begin(), accepted.end());
      joined.reply.batch = named_nodes(accepted);
    } else if (std::holds_alternative<wire::RegisterNodes>(question.body)) {
      const auto registered = question.batch.u64(Field::kNodeId);
      now.insert(now.end(), registered.begin(), registered.end());
    } else {
      Ids gone;
      for (const Shard& shard : shards_) {
        if (!shard.reply) continue;
        const auto ids = shard.request.batch.u64(Field::kNodeId);
        gone.insert(gone.end(), ids.begin(), ids.end());
      }
      std::ranges::sort(gone);
      std::erase_if(now, [&](std::uint64_t id) { return std::ranges::binary_search(gone, id); });
    }
    const std::uint64_t nodes = now.size();
    place(std::make_shared<const Ids>(std::move(now)));
    joined.reply.body = wire::NodesChanged{.nodes = nodes};
  }
  if (!versions.empty()) state_version_ = versions.front();
  last_sequence_ = operation.sequence;
  return joined;
}

// The rows of a step, each from its shard.
Batch ShardedSession::join_rows(std::span<Received* const> replies) const {
  std::vector<Field> fields;
  std::uint32_t components = 1;
  for (const wire::Column& column : replies.front()->reply.batch.columns()) {
    if (column.component == 0) fields.push_back(column.field);
    components = std::max(components, column.component + 1);
  }
  Batch all = Batch::of(fields, operation_->rows, components);
  for (std::size_t k = 0; k < replies.size(); ++k) {
    const Batch& some = std::as_const(replies[k]->reply.batch);
    const auto rows = rows_in(shards_[k]);
    for (const wire::Column& column : all.columns()) {
      const auto copy = [&](auto from, auto to) {
        if (from.size() != rows.size())
          refuse(Code::kUnexpectedReply,
                 fmt::format("shard {} answers {} of {} rows of {}", k, from.size(), rows.size(),
                             wire::name(column.field)),
                 "Are all servers of the same version?");
        for (std::size_t i = 0; i < rows.size(); ++i) to[rows[i]] = from[i];
      };
      if (column.element == wire::Element::kUint8)
        copy(some.u8(column.field), all.u8(column.field));
      else
        copy(some.f64(column.field, column.component), all.f64(column.field, column.component));
    }
  }
  return all;
}

wire::Upscale ShardedSession::join_steps(std::span<Received* const> replies) {
  wire::Upscale sum;
  for (Received* reply : replies) {
    const auto& one = body_of<wire::Upscale>(*reply);
    if (one.nodes != 0 && (sum.nodes == 0 || one.largest_closure_m_per_s > sum.largest_closure_m_per_s)) {
      sum.largest_closure_m_per_s = one.largest_closure_m_per_s;
      sum.closure_node = one.closure_node;
      sum.layer_time_s = one.layer_time_s;
    }
    sum.nodes += one.nodes;
    sum.solver_ns = std::max(sum.solver_ns, one.solver_ns);  // the shards compute at the same time
    sum.service_ns = std::max(sum.service_ns, one.service_ns);
    sum.flagged_nodes += one.flagged_nodes;
    for (const std::string& warning : one.warnings)
      if (std::ranges::find(sum.warnings, warning) == sum.warnings.end()) sum.warnings.push_back(warning);
  }
  return sum;
}

// The profiles of nodes of several shards: each shard answers with the rows of its nodes, which are joined in the order
// of the request. The request changes nothing, so it is no operation under way.
Received ShardedSession::read_profiles(const wire::Request& request) {
  const auto rows = rows_of_shards(request.batch.u64(Field::kNodeId), links_.size());
  Received joined;
  auto& sum = joined.reply.body.emplace<wire::Profiles>();
  sum.nodes = request.batch.u64(Field::kNodeId).size();
  sum.state_version = state_version_;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    if (rows[k].empty()) continue;
    links_.left(k);
    Received received = shards_[k].session->read_profiles(rows_of(request.batch, rows[k]));
    const auto& one = body_of<wire::Profiles>(received);
    const Batch& some = std::as_const(received.reply.batch);
    Batch& all = joined.reply.batch;
    if (all.columns().empty()) {
      sum.vertices = one.vertices;
      all = columns_of(some, sum.nodes * sum.vertices);
    }
    for (const wire::Column& column : all.columns()) {
      const auto copy = [&](auto from, auto to) {
        if (one.vertices != sum.vertices || from.size() != rows[k].size() * sum.vertices)
          refuse(Code::kUnexpectedReply, fmt::format("shard {} answers other rows of a profile", k),
                 "Are all servers of the same version?");
        for (std::size_t i = 0; i < rows[k].size(); ++i)
          std::ranges::copy(from.subspan(i * sum.vertices, sum.vertices), to.begin() + rows[k][i] * sum.vertices);
      };
      if (column.element == wire::Element::kUint64)
        copy(some.u64(column.field), all.u64(column.field));
      else
        copy(some.f64(column.field, column.component), all.f64(column.field, column.component));
    }
  }
  if (joined.reply.batch.columns().empty())
    refuse(Code::kShape, "read_profiles needs at least one node; none was given", "Name a node.", Field::kNodeId);
  return joined;
}

// ---- the order of the rows ----

// Makes `order` the order of the rows. Returns false, and changes nothing, if the shards have other nodes.
bool ShardedSession::place(std::shared_ptr<const Ids> order) {
  std::vector<std::pair<std::uint64_t, std::uint32_t>> row_of;
  row_of.reserve(order->size());
  for (const std::uint64_t id : *order) row_of.emplace_back(id, static_cast<std::uint32_t>(row_of.size()));
  std::ranges::sort(row_of);
  std::size_t placed = 0;
  std::vector<std::vector<std::uint32_t>> rows(shards_.size());
  for (std::size_t k = 0; k < shards_.size(); ++k)
    for (const std::uint64_t id : shards_[k].session->node_ids) {
      const auto at = std::ranges::lower_bound(row_of, id, {}, &std::pair<std::uint64_t, std::uint32_t>::first);
      if (at == row_of.end() || at->first != id) return false;
      rows[k].push_back(at->second);
      ++placed;
    }
  if (placed != order->size()) return false;
  for (std::size_t k = 0; k < shards_.size(); ++k) shards_[k].rows = std::move(rows[k]);
  node_ids_ = std::move(order);
  return true;
}

ShardedSession::Ids ShardedSession::merged() const {
  std::vector<std::span<const std::uint64_t>> lists;
  for (const Shard& shard : shards_) lists.emplace_back(shard.session->node_ids);
  return merge_of(std::move(lists));
}

// ---- successors, and the end ----

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
        shard.reply =
            shard.session->send(shard.request, [](Received& received) { body_of<wire::SessionClosed>(received); });
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
