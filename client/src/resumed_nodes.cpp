#include "client/src/resumed_nodes.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "client/src/session.hpp"

namespace shearbus {
namespace {

constexpr std::size_t kMostNamed = 16;  // node ids in an error

class NodeCheck {
 public:
  NodeCheck(const Received& where, const ExpectedNodes& expected)
      : resumed_(std::get<wire::SessionResumed>(where.reply.body).session),
        rows_(where.reply.batch),
        expected_(expected) {
    const auto ids = rows_.u64(Field::kNodeId);
    for (std::size_t row = 0; row < ids.size(); ++row) row_of_[ids[row]] = row;
  }

  void run() {
    for (const NodeOptions::Parameter& parameter : expected_.options.parameters) check_key(parameter);
    for (std::size_t i = 0; i < expected_.node_ids.size(); ++i) compare(i);
    if (named_.empty()) return;
    throw Error(
        {.code = Code::kResumeRefused,
         .text = fmt::format("{} ({} of {} nodes are not as expected)", first_, faults_, expected_.node_ids.size()),
         .remedy =
             "The session was left as it is. Resume with the nodes as they were registered; after a change of the "
             "mesh without nodes, then retire and register what has changed; or open a new session.",
         .field = field_,
         .node_ids = named_});
  }

 private:
  void check_key(const NodeOptions::Parameter& parameter) {
    if (parameter.values.size() != expected_.node_ids.size())
      throw Error({.code = Code::kShape,
                   .text = fmt::format("{} values of {} for {} nodes", parameter.values.size(), parameter.key,
                                       expected_.node_ids.size()),
                   .field = parameter.key});
    const auto found = std::ranges::find(resumed_.parameters, parameter.key);
    if (found == resumed_.parameters.end())
      throw Error({.code = Code::kResumeRefused,
                   .text = fmt::format(
                       "{} is no parameter of the nodes of this session, which has {}", parameter.key,
                       resumed_.parameters.empty() ? "none" : fmt::format("{}", fmt::join(resumed_.parameters, ", "))),
                   .remedy = "The opening of a session chooses the keys.",
                   .field = parameter.key});
    components_.push_back(static_cast<std::uint32_t>(found - resumed_.parameters.begin()));
  }

  void compare(std::size_t i) {
    const auto found = row_of_.find(expected_.node_ids[i]);
    if (found == row_of_.end())
      return note(
          i, "node_id",
          fmt::format("node {} is not in the session, which has {} nodes", expected_.node_ids[i], row_of_.size()));
    const NodeOptions& options = expected_.options;
    if (!options.pair.empty()) {
      const std::string& wanted = options.pairs.at(options.pair[i]);
      if (const std::string has = pair_in(found->second); has != wanted)
        return note(i, "pair",
                    fmt::format("node {} has the pair \"{}\" in the session, the host \"{}\"", expected_.node_ids[i],
                                has, wanted));
    }
    for (std::size_t key = 0; key < components_.size(); ++key) {
      const auto column = rows_.f64(Field::kParameter, components_[key]);
      if (column.empty()) refuse_unknown();
      if (const double wanted = options.parameters[key].values[i]; column[found->second] != wanted)
        return note(i, options.parameters[key].key,
                    fmt::format("{} of node {} is {} in the session, {} of the host", options.parameters[key].key,
                                expected_.node_ids[i], column[found->second], wanted));
    }
  }

  std::string pair_in(std::size_t row) const {
    if (resumed_.pairs.empty()) return {};
    const auto column = rows_.u64(Field::kPair);
    if (column.empty()) refuse_unknown();
    return column[row] == 0 ? std::string() : resumed_.pairs.at(column[row] - 1);
  }

  [[noreturn]] static void refuse_unknown() {
    throw Error({.code = Code::kUnsupported,
                 .text = "the server does not tell the pairs and parameters of the nodes of a resumed session",
                 .remedy = "Resume without them, or use a newer server; of more nodes than a message has room for it "
                           "does not tell them, either."});
  }

  void note(std::size_t i, const std::string& field, std::string text) {
    if (++faults_ == 1) {
      first_ = std::move(text);
      field_ = field;
    }
    if (named_.size() < kMostNamed) named_.push_back(expected_.node_ids[i]);
  }

  const wire::SessionOpened& resumed_;
  const Batch& rows_;
  const ExpectedNodes& expected_;
  std::unordered_map<std::uint64_t, std::size_t> row_of_;
  std::vector<std::uint32_t> components_;  // of each expected parameter, in the session's list
  std::vector<std::uint64_t> named_;
  std::size_t faults_ = 0;
  std::string first_, field_;
};

}  // namespace

void check_resumed_nodes(const Received& where, const ExpectedNodes& expected) {
  if (expected.options.pair.size() != (expected.options.pairs.empty() ? 0 : expected.node_ids.size()))
    throw Error({.code = Code::kShape,
                 .text = fmt::format("{} pairs for {} nodes", expected.options.pair.size(), expected.node_ids.size()),
                 .remedy = "Give one per node, or none.",
                 .field = "pair"});
  if (!expected.node_ids.empty()) NodeCheck(where, expected).run();
}

std::string nodes_left_out(const Received& where, const ExpectedNodes& expected) {
  const auto ids = where.reply.batch.u64(Field::kNodeId);
  if (expected.node_ids.empty() || expected.node_ids.size() == ids.size())
    return {};  // each named node is in the session
  std::vector<std::uint64_t> named(expected.node_ids.begin(), expected.node_ids.end());
  std::ranges::sort(named);
  const auto left_out = [&](std::uint64_t id) { return !std::ranges::binary_search(named, id); };
  return fmt::format(
      "resume: the session has {} nodes that the host does not name, such as node {}: their layers are kept, and a "
      "step "
      "without node_ids has rows for them, too. Retire them if the mesh has lost them",
      std::ranges::count_if(ids, left_out), *std::ranges::find_if(ids, left_out));
}

ResumedNodes resumed_nodes(const Batch& rows, const wire::SessionOpened& session) {
  const auto copy = [](const auto& column, auto& to) { to.assign(column.begin(), column.end()); };
  ResumedNodes nodes;
  copy(rows.u64(Field::kNodeId), nodes.node_ids);
  if (!rows.has(Field::kPair)) return nodes;  // neither pairs nor parameters, or the server did not tell
  copy(rows.u64(Field::kPair), nodes.pair);
  nodes.parameters.resize(session.parameters.size());
  for (std::uint32_t key = 0; key < nodes.parameters.size(); ++key)
    copy(rows.f64(Field::kParameter, key), nodes.parameters[key]);
  return nodes;
}

}  // namespace shearbus
