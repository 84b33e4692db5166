// The nodes of a shard in the order of their registration (one row per node), and the slot that holds a node's state.
//
// Which slots are free, and where nodes move when others leave, is the matter of tile_map.hpp; the order of the rows
// never changes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "server/shard/tile_map.hpp"

namespace shearbus::shard {

// The slots of the nodes that a request names, one node per row of the request, and the faults of its node ids.
struct Rows {
  bool all = false;                      // the request has every node, in the order of the table; the lists are empty
  bool others_are_open = false;          // nodes that the request leaves out are stepped too, with P = 0 and no forces
  std::vector<std::uint32_t> slots;      // slot of the node in each row of the request
  std::vector<std::uint64_t> unknown;    // ids that the table does not have, in the order of the request
  std::vector<std::uint64_t> duplicate;  // ids that the request has more than once
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
  // The ids of `sorted` (ascending) that the table has.
  std::vector<std::uint64_t> common(std::span<const std::uint64_t> sorted) const;

  bool slots_are_rows() const { return slots_.empty(); }
  std::uint32_t slot_of(std::size_t row) const {
    return slots_.empty() ? static_cast<std::uint32_t>(row) : slots_[row];
  }

  // Returns this table with more nodes in the given slots. Their ids must differ from each other and from those in the
  // table.
  NodeTable with(std::span<const std::uint64_t> node_ids, std::span<const std::uint32_t> slots) const;
  // Returns this table after its nodes have moved: without those that left (TileMap::Change::slot_now).
  NodeTable moved(std::span<const std::uint32_t> slot_now) const;

  // Memory in bytes of one node in the table, including its entry in slots_.
  static constexpr std::uint64_t kBytesPerNode =
      sizeof(std::uint64_t) + sizeof(std::pair<std::uint64_t, std::uint32_t>) + sizeof(std::uint32_t);

 private:
  // by_id_ is a sorted table, not a hash table: clients choose the ids, and no choice makes a binary search slow.
  std::vector<std::uint64_t> ids_;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> by_id_;  // node ids, ascending, each with its place in ids_
  std::vector<std::uint32_t> slots_;  // slot of each node of ids_; empty: the slot is the place in ids_
};

}  // namespace shearbus::shard
