#include "server/shard/node_table.hpp"

#include <algorithm>

namespace shearbus::shard {

NodeTable::NodeTable(std::vector<std::uint64_t> node_ids) : ids_(std::move(node_ids)) {
  by_id_.reserve(ids_.size());
  for (std::size_t row = 0; row < ids_.size(); ++row) by_id_.emplace_back(ids_[row], static_cast<std::uint32_t>(row));
  std::sort(by_id_.begin(), by_id_.end());
}

std::vector<std::uint64_t> NodeTable::repeated(std::span<const std::uint64_t> node_ids) {
  std::vector<std::uint64_t> sorted(node_ids.begin(), node_ids.end());
  std::sort(sorted.begin(), sorted.end());
  std::vector<std::uint64_t> repeated;
  for (std::size_t i = 1; i < sorted.size(); ++i)
    if (sorted[i] == sorted[i - 1] && (repeated.empty() || repeated.back() != sorted[i])) repeated.push_back(sorted[i]);
  return repeated;
}

Rows NodeTable::locate(std::span<const std::uint64_t> node_ids) const {
  Rows rows;
  rows.slots.reserve(node_ids.size());
  std::vector<bool> taken(ids_.size(), false);
  std::size_t guess = 0;  // likely row of the next id: ids usually come in table order, or in runs of it
  for (const std::uint64_t id : node_ids) {
    std::size_t row = guess;
    if (row >= ids_.size() || ids_[row] != id) {
      const auto found = std::lower_bound(by_id_.begin(), by_id_.end(), std::pair{id, std::uint32_t{0}});
      if (found == by_id_.end() || found->first != id) {
        rows.unknown.push_back(id);
        continue;
      }
      row = found->second;
    }
    if (taken[row])
      rows.duplicate.push_back(id);
    else
      rows.slots.push_back(slot_of(row));
    taken[row] = true;
    guess = row + 1;
  }
  return rows;
}

std::vector<std::uint64_t> NodeTable::common(std::span<const std::uint64_t> sorted) const {
  std::vector<std::uint64_t> common;
  if (sorted.empty() || by_id_.empty()) return common;
  auto at = std::lower_bound(by_id_.begin(), by_id_.end(), std::pair{sorted.front(), std::uint32_t{0}});
  for (auto id = sorted.begin(); id != sorted.end() && at != by_id_.end();) {
    if (at->first < *id) {
      ++at;
    } else {
      if (at->first == *id) common.push_back(*id);
      ++id;
    }
  }
  return common;
}

NodeTable NodeTable::with(std::span<const std::uint64_t> node_ids, std::span<const std::uint32_t> slots) const {
  NodeTable table;
  const std::size_t before = size();
  const std::size_t after = before + node_ids.size();
  table.ids_.reserve(after);
  table.ids_ = ids_;
  table.ids_.insert(table.ids_.end(), node_ids.begin(), node_ids.end());
  table.by_id_.reserve(after);
  table.by_id_ = by_id_;
  for (std::size_t row = before; row < after; ++row)
    table.by_id_.emplace_back(table.ids_[row], static_cast<std::uint32_t>(row));
  const auto first_new = table.by_id_.begin() + static_cast<std::ptrdiff_t>(before);
  std::sort(first_new, table.by_id_.end());
  std::inplace_merge(table.by_id_.begin(), first_new, table.by_id_.end());
  bool slots_are_rows = this->slots_are_rows();
  for (std::size_t i = 0; i < slots.size(); ++i) slots_are_rows = slots_are_rows && slots[i] == before + i;
  if (slots_are_rows) return table;
  table.slots_.reserve(after);
  for (std::size_t row = 0; row < before; ++row) table.slots_.push_back(slot_of(row));
  table.slots_.insert(table.slots_.end(), slots.begin(), slots.end());
  return table;
}

NodeTable NodeTable::moved(std::span<const std::uint32_t> slot_now) const {
  NodeTable table;
  std::size_t left = 0;
  for (std::size_t row = 0; row < size(); ++row) left += slot_now[slot_of(row)] != TileMap::kGone ? 1 : 0;
  table.ids_.reserve(left);
  table.slots_.reserve(left);
  std::vector<std::uint32_t> row_now(size(), TileMap::kGone);
  bool slots_are_rows = true;
  for (std::size_t row = 0; row < size(); ++row) {
    const std::uint32_t slot = slot_now[slot_of(row)];
    if (slot == TileMap::kGone) continue;
    row_now[row] = static_cast<std::uint32_t>(table.ids_.size());
    slots_are_rows = slots_are_rows && slot == row_now[row];
    table.ids_.push_back(ids_[row]);
    table.slots_.push_back(slot);
  }
  if (slots_are_rows) table.slots_ = {};
  table.by_id_.reserve(left);
  for (const auto& [id, row] : by_id_)
    if (row_now[row] != TileMap::kGone) table.by_id_.emplace_back(id, row_now[row]);
  return table;
}

}  // namespace shearbus::shard
