#include "server/shard/states.hpp"

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "server/shard/shard.hpp"

namespace shearbus::shard {

using physics::kLanes;

std::uint32_t Shard::tile_of(std::uint32_t slot) {
  return slot / kLanes;
}

States blank_states(std::span<const physics::State> known, const PairTable& pairs, const TileMap& map,
                    std::vector<std::uint32_t> rows, std::span<const std::uint32_t> slots) {
  States states{.rows = std::move(rows)};
  for (const physics::State& state : known)
    states.columns.push_back({.name = state.name,
                              .units = state.unit,
                              .width = state.width,
                              .values = std::vector<double>(slots.size() * state.width)});
  for (std::size_t i = 0; i < pairs.columns().size(); ++i) {
    const PairColumn& of_pair = pairs.columns()[i];
    StateColumn column{.name = of_pair.name, .units = of_pair.units, .width = 1};
    for (const std::uint32_t slot : slots) column.values.push_back(pairs[map.pair_of(slot / kLanes)].values[i]);
    states.columns.push_back(std::move(column));
  }
  return states;
}

void put_state(const double* from, std::span<const physics::State> known, std::size_t place, States& states) {
  for (std::size_t column = 0; column < known.size(); ++column) {
    const std::size_t width = known[column].width;
    const double* values = from + known[column].offset;
    double* to = states.columns[column].values.data() + place * width;
    for (std::size_t i = 0; i < width; ++i) to[i] = values[i * kLanes];
  }
}

States Shard::states_in(std::vector<std::uint32_t> rows, std::span<const std::uint32_t> slots, bool of_trial) const {
  States states = blank_states(layout_.states(), pairs_, map_, std::move(rows), slots);
  for (std::size_t place = 0; place < slots.size(); ++place) {
    const std::uint32_t tile = tile_of(slots[place]);
    const bool in_trial = of_trial && std::binary_search(touched_.begin(), touched_.end(), tile);
    put_state(buffer(tile, in_trial ? 1U - committed_[tile] : committed_[tile]) + slots[place] % kLanes,
              layout_.states(), place, states);
  }
  return states;
}

States Shard::committed_states() const {
  std::vector<std::uint32_t> slots(nodes_->size());
  for (std::size_t row = 0; row < slots.size(); ++row) slots[row] = nodes_->slot_of(row);
  return states_of(slots, false);
}

States Shard::states_of(std::span<const std::uint32_t> slots, bool of_trial) const {
  std::vector<std::uint32_t> rows(slots.size());
  std::iota(rows.begin(), rows.end(), 0U);
  return states_in(std::move(rows), slots, of_trial);
}

States Shard::trial_states() const {
  std::vector<std::uint32_t> rows;
  std::vector<std::uint32_t> slots;
  for (std::uint32_t row = 0; row < nodes_->size(); ++row)
    if (const std::uint32_t slot = nodes_->slot_of(row);
        std::binary_search(touched_.begin(), touched_.end(), tile_of(slot))) {
      rows.push_back(row);
      slots.push_back(slot);
    }
  return states_in(std::move(rows), slots, true);
}

void Shard::check_states(const States& states, std::size_t nodes) const {
  const std::span<const physics::State> known = layout_.states();
  const std::vector<PairColumn>& of_pair = pairs_.columns();
  std::size_t next = 0;
  for (const physics::State& state : known) {
    const bool there = next < states.columns.size() && states.columns[next].name == state.name;
    if (!there && state.from_zero) continue;
    if (next++ == states.columns.size()) break;  // the number is wrong
    const StateColumn& column = states.columns[next - 1];
    if (!there || column.width != state.width || column.values.size() != states.rows.size() * state.width)
      throw std::invalid_argument("state column " + column.name + " [" + std::to_string(column.values.size()) +
                                  " values] is not the model's " + state.name + " [" +
                                  std::to_string(states.rows.size()) + "][" + std::to_string(state.width) + "]");
  }
  if (states.columns.size() != next + of_pair.size())
    throw std::invalid_argument("states of " + std::to_string(states.columns.size()) + " columns; the model has " +
                                std::to_string(known.size() + of_pair.size()));
  for (std::size_t i = 0; i < of_pair.size(); ++i)
    if (const StateColumn& column = states.columns[next + i];
        column.name != of_pair[i].name || column.width != 1 || column.values.size() != states.rows.size())
      throw std::invalid_argument("state column " + column.name + " is not the column of pairs " + of_pair[i].name);
  for (const std::uint32_t row : states.rows)
    if (row >= nodes) throw std::invalid_argument("states of row " + std::to_string(row) + ", which does not exist");
}

void Shard::put_states(const States& states, bool of_trial) {
  write_states(states, layout_.states(), [&](std::size_t i) {
    const std::uint32_t slot = nodes_->slot_of(states.rows[i]);
    const std::uint32_t tile = tile_of(slot);
    return buffer(tile, of_trial ? 1U - committed_[tile] : committed_[tile]) + slot % kLanes;
  });
}

void Shard::restore(const States& committed_states, const States* trial, std::uint64_t state_version) {
  check_states(committed_states, nodes_->size());
  if (trial != nullptr) check_states(*trial, nodes_->size());
  end_cut();
  rollback();
  put_states(committed_states, false);
  state_version_ = state_version;
  if (trial == nullptr) return;
  for (const std::uint32_t row : trial->rows) touched_.push_back(tile_of(nodes_->slot_of(row)));
  std::sort(touched_.begin(), touched_.end());
  touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
  // A tile may have lanes without a row in `trial`, as those beyond the last node. They need valid states, too.
  for (const std::uint32_t tile : touched_)
    std::copy_n(committed(tile), layout_.doubles, buffer(tile, 1U - committed_[tile]));
  put_states(*trial, true);
  has_trial_ = true;
}

}  // namespace shearbus::shard
