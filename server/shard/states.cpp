#include "server/shard/states.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "server/shard/shard.hpp"

namespace shearbus::shard {

using physics::kLanes;

std::vector<StatePart> state_parts(const physics::TileLayout& layout) {
  const StatePart known[] = {{"hard_temperature_k", "K", layout.hard_temperature, layout.num_hard_vertices},
                             {"heat_modes_k", "K", layout.heat_modes, layout.num_heat_modes},
                             {"temperature_k", "K", layout.temperature, layout.num_vertices},
                             {"plastic_strain", "1", layout.plastic_strain, layout.num_strain_vertices},
                             {"heat_shape", "1", layout.heat_shape, layout.num_strain_vertices},
                             {"shear_stress_pa", "Pa", layout.shear_stress, 1},
                             {"regime", "1", layout.regime, 1},
                             {"sticking", "1", layout.sticking, 1}};
  std::vector<StatePart> parts;
  std::size_t doubles = 0;
  for (const StatePart& part : known) {
    if (part.offset == physics::TileLayout::kAbsent) continue;
    parts.push_back(part);
    doubles += part.width * kLanes;
  }
  if (doubles != layout.doubles) throw std::logic_error("a tile has parts that no state column names");
  return parts;
}

std::uint32_t Shard::tile_of(std::uint32_t slot) {
  return slot / kLanes;
}

States Shard::states_in(const std::vector<std::uint32_t>& slots, bool of_trial) const {
  States states{.slots = slots, .columns = {}};
  for (const StatePart& part : state_parts(model_.layout())) {
    StateColumn column{.name = part.name, .units = part.units, .width = part.width, .values = {}};
    column.values.reserve(slots.size() * part.width);
    for (const std::uint32_t slot : slots) {
      const std::uint32_t tile = tile_of(slot);
      const double* from =
          buffer(tile, of_trial ? 1U - committed_[tile] : committed_[tile]) + part.offset + slot % kLanes;
      for (std::size_t i = 0; i < part.width; ++i) column.values.push_back(from[i * kLanes]);
    }
    states.columns.push_back(std::move(column));
  }
  return states;
}

States Shard::committed_states() const {
  std::vector<std::uint32_t> slots(nodes_.size());
  for (std::uint32_t slot = 0; slot < slots.size(); ++slot) slots[slot] = slot;
  return states_in(slots, false);
}

States Shard::trial_states() const {
  std::vector<std::uint32_t> slots;
  for (const std::uint32_t tile : touched_)
    for (std::uint32_t slot = tile * kLanes; slot < (tile + 1) * kLanes && slot < nodes_.size(); ++slot)
      slots.push_back(slot);
  return states_in(slots, true);
}

void Shard::put_states(const States& states, bool of_trial) {
  const std::vector<StatePart> parts = state_parts(model_.layout());
  if (states.columns.size() != parts.size())
    throw std::invalid_argument("states of " + std::to_string(states.columns.size()) + " columns; the model has " +
                                std::to_string(parts.size()));
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const StatePart& part = parts[i];
    const StateColumn& column = states.columns[i];
    if (column.name != part.name || column.width != part.width ||
        column.values.size() != states.slots.size() * part.width)
      throw std::invalid_argument("state column " + column.name + " [" + std::to_string(column.values.size()) +
                                  " values] is not the model's " + part.name + " [" +
                                  std::to_string(states.slots.size()) + "][" + std::to_string(part.width) + "]");
  }
  for (const std::uint32_t slot : states.slots)
    if (slot >= nodes_.size())
      throw std::invalid_argument("states of slot " + std::to_string(slot) + ", which does not exist");
  for (std::size_t i = 0; i < parts.size(); ++i)
    for (std::size_t row = 0; row < states.slots.size(); ++row) {
      const std::uint32_t slot = states.slots[row];
      const std::uint32_t tile = tile_of(slot);
      double* to = buffer(tile, of_trial ? 1U - committed_[tile] : committed_[tile]) + parts[i].offset + slot % kLanes;
      const double* from = states.columns[i].values.data() + row * parts[i].width;
      for (std::size_t j = 0; j < parts[i].width; ++j) to[j * kLanes] = from[j];
    }
}

void Shard::restore(const States& committed, const States* trial, std::uint64_t state_version) {
  rollback();
  put_states(committed, false);
  state_version_ = state_version;
  if (trial == nullptr) return;
  for (const std::uint32_t slot : trial->slots) {
    if (slot >= nodes_.size())
      throw std::invalid_argument("a trial of slot " + std::to_string(slot) + ", which does not exist");
    const std::uint32_t tile = tile_of(slot);
    if (!touched_.empty() && touched_.back() == tile) continue;
    touched_.push_back(tile);
    // Lanes beyond the last node: whatever they hold, no node's answer depends on it, but it must be a state.
    std::copy_n(buffer(tile, committed_[tile]), model_.layout().doubles, buffer(tile, 1U - committed_[tile]));
  }
  put_states(*trial, true);
  has_trial_ = true;
}

}  // namespace shearbus::shard
