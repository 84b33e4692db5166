// Joins the answers of several servers, whose rows have the order of the host's nodes.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
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

std::uint64_t ShardedSession::same_version(std::span<const std::uint64_t> versions) {
  if (!all_equal(versions)) {
    torn_ = fmt::format("the shards are not at the same step: their state versions are {}", fmt::join(versions, ", "));
    operation_.reset();
    refuse_call(Code::kEpoch, torn_,
                "Roll back to a mark that all shards have, or start again from the host's restart point.");
  }
  return versions.front();
}

// The state version that the answers of all shards tell.
template <typename Answer>
std::uint64_t ShardedSession::version_of_all() {
  std::vector<std::uint64_t> versions;
  for (Shard& shard : shards_) versions.push_back(body_of<Answer>(*shard.reply).state_version);
  return state_version_ = same_version(versions);
}

// The reply to a request that all its shards have run.
Received ShardedSession::join() {
  Operation& operation = *operation_;
  Received joined;
  for (const Shard& shard : shards_)
    if (shard.reply) joined.round_trip = std::max(joined.round_trip, shard.reply->round_trip);
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
    sum.state_version = committed ? version_of_all<wire::Committed>() : version_of_all<wire::Upscale>();
    joined.reply.body = std::move(sum);
    trial_stands_ = !committed && last_of_step(*step);
    previous_committed_ = false;
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
    wire::Marked marked = body_of<wire::Marked>(*shards_.front().reply);
    for (Shard& shard : shards_)
      std::erase_if(marked.names, [&](const std::string& name) {
        const auto& others = body_of<wire::Marked>(*shard.reply).names;
        return std::ranges::find(others, name) == others.end();
      });
    marks_[std::get<wire::Mark>(question.body).name] = node_ids_;
    std::erase_if(marks_,
                  [&](const auto& mark) { return std::ranges::find(marked.names, mark.first) == marked.names.end(); });
    marked.state_version = version_of_all<wire::Marked>();
    joined.reply.body = std::move(marked);
  } else {
    Ids now = *node_ids_;
    if (asks<wire::AcceptNodes>(question)) {
      std::vector<std::span<const std::uint64_t>> lists;
      for (Shard& shard : shards_)
        if (shard.reply) lists.push_back(std::as_const(shard.reply->reply.batch).u64(Field::kNodeId));
      const Ids accepted = merge_of(std::move(lists));
      now.insert(now.end(), accepted.begin(), accepted.end());
      joined.reply.batch = named_nodes(accepted);
    } else if (asks<wire::RegisterNodes>(question)) {
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
  last_sequence_ = operation.sequence;
  return joined;
}

// The rows of a step, each from its shard.
Batch ShardedSession::join_rows(std::span<Received* const> replies) const {
  Batch all = columns_of(replies.front()->reply.batch, operation_->rows);
  for (std::size_t k = 0; k < replies.size(); ++k) {
    const auto rows = rows_in(shards_[k]);
    each_column(std::as_const(replies[k]->reply.batch), all, [&](const wire::Column& column, auto from, auto to) {
      if (from.size() != rows.size())
        refuse_call(
            Code::kUnexpectedReply,
            fmt::format("shard {} answers {} of {} rows of {}", k, from.size(), rows.size(), wire::name(column.field)),
            "Are all servers of the same version?");
      for (std::size_t i = 0; i < rows.size(); ++i) to[rows[i]] = from[i];
    });
  }
  return all;
}

wire::Upscale ShardedSession::join_steps(std::span<Received* const> replies) {
  wire::Upscale sum;
  for (Received* reply : replies) {
    const auto& one = body_of<wire::Upscale>(*reply);
    add_rows(sum, one);
    sum.solver_ns = std::max(sum.solver_ns, one.solver_ns);  // the shards compute at the same time
    sum.service_ns = std::max(sum.service_ns, one.service_ns);
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
    each_column(some, all, [&](const wire::Column&, auto from, auto to) {
      if (one.vertices != sum.vertices || from.size() != rows[k].size() * sum.vertices)
        refuse_call(Code::kUnexpectedReply, fmt::format("shard {} answers other rows of a profile", k),
                    "Are all servers of the same version?");
      for (std::size_t i = 0; i < rows[k].size(); ++i)
        std::ranges::copy(from.subspan(i * sum.vertices, sum.vertices), to.begin() + rows[k][i] * sum.vertices);
    });
  }
  if (joined.reply.batch.columns().empty())
    refuse_call(Code::kShape, "read_profiles needs at least one node; none was given", "Name a node.", Field::kNodeId);
  return joined;
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
