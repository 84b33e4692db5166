// Which nodes there are, in the order in which they came, and which slot holds the state of each.
//
// Slots are dense: n nodes lie in the slots 0 to n - 1. New nodes take the slots behind them; where nodes leave, those
// in the last slots move into the holes. The order of the rows does not change by that: it is the order of arrival.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace shearbus::shard {

// Where rows of a request belong, or what is wrong with them.
struct Rows {
  bool all = false;                      // every node, in the table's order; the lists are empty then
  std::vector<std::uint32_t> slots;      // of each row
  std::vector<std::uint64_t> unknown;    // ids that are not of this table, in row order
  std::vector<std::uint64_t> duplicate;  // ids that came before in the same request
  bool ok() const { return unknown.empty() && duplicate.empty(); }
};

// A state that moves to another slot.
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
  // Those of `sorted` that are of this table.
  std::vector<std::uint64_t> common(std::span<const std::uint64_t> sorted) const;

  bool slots_are_rows() const { return slots_.empty(); }
  std::uint32_t slot_of(std::size_t row) const {
    return slots_.empty() ? static_cast<std::uint32_t>(row) : slots_[row];
  }

  // This table with more nodes; ids must be unique, and none of this table.
  NodeTable with(std::span<const std::uint64_t> node_ids) const;
  // This table without the nodes in these slots, and what moves into the holes they leave.
  std::pair<NodeTable, std::vector<Relocation>> without(std::span<const std::uint32_t> slots) const;

  // Memory of a node, that of slots_ included.
  static constexpr std::uint64_t kBytesPerNode =
      sizeof(std::uint64_t) + sizeof(std::pair<std::uint64_t, std::uint32_t>) + sizeof(std::uint32_t);

 private:
  // A sorted table and not a hash: ids come from outside, and nobody can choose ids that make a binary search slow.
  std::vector<std::uint64_t> ids_;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> by_id_;  // and the row
  std::vector<std::uint32_t> slots_;                            // of each row; empty: as the rows
};

}  // namespace shearbus::shard
