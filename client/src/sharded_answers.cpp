// Joins the answers of several servers, whose rows have the order of the host's nodes.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <functional>
#include <utility>
#include <variant>

#include "client/src/sharded_session.hpp"

namespace shearbus {
namespace {

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

}  // namespace

// Returns false, and ends the operation, if the shards have different states.
bool ShardedSession::agree(std::span<const std::uint64_t> versions) {
  if (std::ranges::adjacent_find(versions, std::not_equal_to{}) == versions.end()) return true;
  torn_ = fmt::format("the shards are not at the same step: their state versions are {}", fmt::join(versions, ", "));
  operation_.reset();
  return false;
}

void ShardedSession::refuse_torn() const {
  refuse_call(Code::kEpoch, torn_,
              "Roll back to a mark that all shards have, or start again from the host's restart point.");
}

// The state version that the answers of all shards tell.
template <typename Answer>
std::uint64_t ShardedSession::version_of_all() {
  std::vector<std::uint64_t> versions;
  for (Asked& asked : operation_->asked) versions.push_back(body_of<Answer>(*asked.reply).state_version);
  if (!agree(versions)) refuse_torn();
  return state_version_ = versions.front();
}

// The reply to a request that all its shards have run.
Received ShardedSession::join() {
  std::vector<Asked>& asked = operation_->asked;
  Received joined;
  for (const Asked& of_shard : asked)
    if (of_shard.reply) joined.round_trip = std::max(joined.round_trip, of_shard.reply->round_trip);
  const wire::Request& question = operation_->question;
  if (const auto* step = std::get_if<wire::Downscale>(&question.body)) {
    join_step(*step, joined);
  } else if (asks<wire::OpenSession>(question)) {
    auto& all = joined.reply.body.emplace<wire::SessionOpened>(body_of<wire::SessionOpened>(*asked.front().reply));
    for (Asked& of_shard : asked) add_warnings(all.warnings, body_of<wire::SessionOpened>(*of_shard.reply).warnings);
  } else if (asks<wire::Commit>(question)) {
    joined.reply.body = wire::Committed{.state_version = version_of_all<wire::Committed>()};
    trial_stands_ = false;
  } else if (const auto* rollback = std::get_if<wire::Rollback>(&question.body)) {
    joined.reply.body = wire::RolledBack{.state_version = version_of_all<wire::RolledBack>()};
    torn_.clear();
    trial_stands_ = previous_committed_ = false;
    if (!rollback->to_mark.empty()) {
      const auto mark = marks_.find(rollback->to_mark);
      if (mark == marks_.end() || !place(mark->second)) place(std::make_shared<const Ids>(merged()));
      joined.reply.batch = named_nodes(*node_ids_);
    }
  } else if (asks<wire::Mark>(question)) {
    wire::Marked marked = body_of<wire::Marked>(*asked.front().reply);
    for (Asked& of_shard : asked)
      std::erase_if(marked.names, [&](const std::string& name) {
        const auto& others = body_of<wire::Marked>(*of_shard.reply).names;
        return std::ranges::find(others, name) == others.end();
      });
    marks_[std::get<wire::Mark>(question.body).name] = node_ids_;
    std::erase_if(marks_,
                  [&](const auto& mark) { return std::ranges::find(marked.names, mark.first) == marked.names.end(); });
    marked.state_version = version_of_all<wire::Marked>();
    joined.reply.body = std::move(marked);
  } else {
    if (asks<wire::AcceptNodes>(question)) {
      std::vector<std::span<const std::uint64_t>> lists;
      for (const Asked& of_shard : asked)
        if (of_shard.reply) lists.push_back(of_shard.reply->reply.batch.u64(Field::kNodeId));
      joined.reply.batch = named_nodes(merge_of(std::move(lists)));
    }
    Ids now = *node_ids_;
    change_nodes(now, question, joined.reply.batch);
    const std::uint64_t nodes = now.size();
    place(std::make_shared<const Ids>(std::move(now)));
    joined.reply.body = wire::NodesChanged{.nodes = nodes};
  }
  last_sequence_ = operation_->sequence;
  return joined;
}

void ShardedSession::join_step(const wire::Downscale& step, Received& joined) {
  const bool committed = operation_->stage == Stage::kCommit;
  wire::Upscale sum;
  std::vector<Answered> answers;
  for (std::size_t k = 0; k < shards_.size(); ++k) {
    Asked& asked = operation_->asked[k];
    Received& reply = committed ? *asked.answer : *asked.reply;
    const auto& one = body_of<wire::Upscale>(reply);
    add_rows(sum, one);
    sum.solver_ns = std::max(sum.solver_ns, one.solver_ns);  // the shards compute at the same time
    sum.service_ns = std::max(sum.service_ns, one.service_ns);
    joined.round_trip = std::max(joined.round_trip, reply.round_trip);
    answers.push_back({k, reply.reply.batch, rows_in(*operation_, k)});
  }
  joined.reply.batch = join_rows(answers, operation_->rows);
  sum.state_version = committed ? version_of_all<wire::Committed>() : version_of_all<wire::Upscale>();
  joined.reply.body = std::move(sum);
  trial_stands_ = !committed && last_of_step(step);
  previous_committed_ = false;
}

// The rows of the host, each from its shard. The columns are those of the first answer.
Batch ShardedSession::join_rows(std::span<const Answered> answers, std::size_t rows, std::size_t values_per_row) {
  Batch all = columns_of(answers.front().columns, rows * values_per_row);
  for (const Answered& of_shard : answers) {
    const auto places = of_shard.places;
    each_column(of_shard.columns, all, [&](const wire::Column& column, auto from, auto to) {
      if (from.size() != places.size() * values_per_row)
        refuse_call(Code::kUnexpectedReply,
                    fmt::format("shard {} answers {} of {} rows of {}", of_shard.shard, from.size(),
                                places.size() * values_per_row, wire::name(column.field)),
                    "Are all servers of the same version?");
      for (std::size_t row = 0; row < places.size(); ++row)
        for (std::size_t i = 0; i < values_per_row; ++i)
          to[places[row] * values_per_row + i] = from[row * values_per_row + i];
    });
  }
  return all;
}

// The profiles of nodes of several shards. The request changes nothing, so it is no operation under way.
Received ShardedSession::read_profiles(const wire::Request& request) {
  const auto ids = request.batch.u64(Field::kNodeId);
  if (ids.empty())
    refuse_call(Code::kShape, "read_profiles needs at least one node; none was given", "Name a node.", Field::kNodeId);
  const auto rows = rows_of_shards(ids, links_.size());
  std::vector<Received> replies(links_.size());
  std::vector<Answered> answers;
  std::uint64_t vertices = 0;
  for (std::uint32_t k = 0; k < links_.size(); ++k) {
    if (rows[k].empty()) continue;
    links_.left(k);
    replies[k] = shards_[k].session->read_profiles(rows_of(request.batch, rows[k]));
    vertices = body_of<wire::Profiles>(replies[k]).vertices;
    answers.push_back({k, replies[k].reply.batch, rows[k]});
  }
  Received joined;
  joined.reply.batch = join_rows(answers, ids.size(), vertices);
  joined.reply.body = wire::Profiles{.nodes = ids.size(), .vertices = vertices, .state_version = state_version_};
  return joined;
}

Batch ShardedSession::join_nodes(std::span<const Received> replies) const {
  std::vector<Answered> answers;
  for (std::size_t k = 0; k < replies.size(); ++k)
    if (const Batch& some = replies[k].reply.batch; !shards_[k].rows.empty())
      answers.push_back({k, some, shards_[k].rows});
  const bool told = std::ranges::all_of(answers, [](const Answered& one) { return one.columns.has(Field::kPair); });
  return told && !answers.empty() ? join_rows(answers, node_ids_->size()) : named_nodes(*node_ids_);
}

wire::SessionResumed ShardedSession::position() const {
  wire::SessionResumed position{
      .last_sequence = last_sequence_, .state_version = state_version_, .trial_stands = trial_stands_};
  for (const Shard& shard : shards_)
    for (const TransferId& offer : shard.session->offers)
      if (std::ranges::find(position.offers, offer) == position.offers.end()) position.offers.push_back(offer);
  return position;
}

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

}  // namespace shearbus
