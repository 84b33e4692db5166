#include "server/shard/node_table.hpp"

#include <algorithm>

namespace shearbus::shard {

NodeTable::NodeTable(std::vector<std::uint64_t> node_ids) : ids_(std::move(node_ids)) {
  by_id_.reserve(ids_.size());
  for (std::size_t slot = 0; slot < ids_.size(); ++slot)
    by_id_.emplace_back(ids_[slot], static_cast<std::uint32_t>(slot));
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
  std::size_t guess = 0;  // hosts send their nodes in the order of opening, or in runs of it: then no search is needed
  for (const std::uint64_t id : node_ids) {
    std::size_t slot = guess;
    if (slot >= ids_.size() || ids_[slot] != id) {
      const auto found = std::lower_bound(by_id_.begin(), by_id_.end(), std::pair{id, std::uint32_t{0}});
      if (found == by_id_.end() || found->first != id) {
        rows.unknown.push_back(id);
        continue;
      }
      slot = found->second;
    }
    if (taken[slot])
      rows.duplicate.push_back(id);
    else
      rows.slots.push_back(static_cast<std::uint32_t>(slot));
    taken[slot] = true;
    guess = slot + 1;
  }
  return rows;
}

}  // namespace shearbus::shard
