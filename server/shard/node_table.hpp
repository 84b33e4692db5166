// The nodes of a shard in the order of their registration (one row per node), and the slot that holds a node's state.
//
// Slots are dense: n nodes occupy the slots 0 to n - 1. New nodes get the next slots. When nodes leave, the states in
// the last slots move into the free slots; the order of the rows does not change.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

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

// The move of a state to another slot.
struct Relocation {
  std::uint32_t from;
  std::uint32_t to;
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

  // Returns this table with more nodes. Their ids must differ from each other and from those in the table.
  NodeTable with(std::span<const std::uint64_t> node_ids) const;
  // Returns this table without the nodes in the given slots, and the moves of states by which the caller closes the
  // gaps: states of the last slots go to the slots that became free.
  std::pair<NodeTable, std::vector<Relocation>> without(std::span<const std::uint32_t> slots) const;

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
