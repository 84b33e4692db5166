// Which slot a node's state lives in. Slots follow the order in which the nodes were opened.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace shearbus::shard {

// Where rows of a request belong, or what is wrong with them.
struct Rows {
  bool all = false;                      // every node, in opening order; the lists are empty then
  std::vector<std::uint32_t> slots;      // of each row
  std::vector<std::uint64_t> unknown;    // ids that are not of this table, in row order
  std::vector<std::uint64_t> duplicate;  // ids that came before in the same request
  bool ok() const { return unknown.empty() && duplicate.empty(); }
};

class NodeTable {
 public:
  NodeTable() = default;
  explicit NodeTable(std::vector<std::uint64_t> node_ids);  // ids must be unique: see repeated()

  // Ids that occur more than once, each named once, ascending.
  static std::vector<std::uint64_t> repeated(std::span<const std::uint64_t> node_ids);

  std::size_t size() const { return ids_.size(); }
  const std::vector<std::uint64_t>& ids() const { return ids_; }
  Rows locate(std::span<const std::uint64_t> node_ids) const;

 private:
  // A sorted table and not a hash: ids come from outside, and nobody can choose ids that make a binary search slow.
  std::vector<std::uint64_t> ids_;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> by_id_;
};

}  // namespace shearbus::shard
