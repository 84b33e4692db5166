#include "server/shard/states.hpp"

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "server/shard/shard.hpp"

namespace shearbus::shard {

using physics::kLanes;

std::vector<StatePart> state_parts(const physics::Model& model) {
  const physics::TileLayout& layout = model.layout();
  const auto second_row = [](std::size_t offset) {
    return offset == physics::TileLayout::kAbsent ? offset : offset + kLanes;
  };
  const StatePart known[] = {{"hard_temperature_k", "K", layout.hard_temperature, layout.num_hard_vertices},
                             {"heat_modes_k", "K", layout.heat_modes, layout.num_heat_modes},
                             {"temperature_k", "K", layout.temperature, layout.num_vertices},
                             {"plastic_strain", "1", layout.plastic_strain, layout.num_strain_vertices},
                             {"heat_shape", "1", layout.heat_shape, layout.num_strain_vertices},
                             {"shear_stress_pa", "Pa", layout.shear_stress, layout.num_stress_vertices},
                             {"second_shear_stress_pa", "Pa", layout.second_stress, 1},
                             {"layer_velocity_m_per_s", "m s-1", layout.layer_velocity, layout.num_velocity_cells},
                             {"regime", "1", layout.regime, 1},
                             {"sticking", "1", layout.sticking, 1},
                             {"junction_strain", "1", layout.junction_strain, 1},
                             {"resting", "1", layout.resting, 2},
                             {"hottest_at_rest_k", "K", layout.weakest, 1},
                             {"least_strength_at_rest_pa", "Pa", second_row(layout.weakest), 1}};
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

States Shard::states_in(std::vector<std::uint32_t> rows, std::span<const std::uint32_t> slots, bool of_trial) const {
  States states{.rows = std::move(rows), .columns = {}};
  for (const StatePart& part : state_parts(model_)) {
    StateColumn column{.name = part.name, .units = part.units, .width = part.width, .values = {}};
    column.values.reserve(slots.size() * part.width);
    for (const std::uint32_t slot : slots) {
      const std::uint32_t tile = tile_of(slot);
      const bool in_trial = of_trial && std::binary_search(touched_.begin(), touched_.end(), tile);
      const double* from =
          buffer(tile, in_trial ? 1U - committed_[tile] : committed_[tile]) + part.offset + slot % kLanes;
      for (std::size_t i = 0; i < part.width; ++i) column.values.push_back(from[i * kLanes]);
    }
    states.columns.push_back(std::move(column));
  }
  return states;
}

States Shard::committed_states() const {
  std::vector<std::uint32_t> slots(nodes_.size());
  for (std::size_t row = 0; row < slots.size(); ++row) slots[row] = nodes_.slot_of(row);
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
  for (std::uint32_t row = 0; row < nodes_.size(); ++row)
    if (const std::uint32_t slot = nodes_.slot_of(row);
        std::binary_search(touched_.begin(), touched_.end(), tile_of(slot))) {
      rows.push_back(row);
      slots.push_back(slot);
    }
  return states_in(std::move(rows), slots, true);
}

void Shard::check_states(const States& states, std::size_t nodes) const {
  const std::vector<StatePart> parts = state_parts(model_);
  if (states.columns.size() != parts.size())
    throw std::invalid_argument("states of " + std::to_string(states.columns.size()) + " columns; the model has " +
                                std::to_string(parts.size()));
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const StatePart& part = parts[i];
    const StateColumn& column = states.columns[i];
    if (column.name != part.name || column.width != part.width ||
        column.values.size() != states.rows.size() * part.width)
      throw std::invalid_argument("state column " + column.name + " [" + std::to_string(column.values.size()) +
                                  " values] is not the model's " + part.name + " [" +
                                  std::to_string(states.rows.size()) + "][" + std::to_string(part.width) + "]");
  }
  for (const std::uint32_t row : states.rows)
    if (row >= nodes) throw std::invalid_argument("states of row " + std::to_string(row) + ", which does not exist");
}

void Shard::put_states(const States& states, bool of_trial) {
  write_states(states, model_, [&](std::size_t i) {
    const std::uint32_t slot = nodes_.slot_of(states.rows[i]);
    const std::uint32_t tile = tile_of(slot);
    return buffer(tile, of_trial ? 1U - committed_[tile] : committed_[tile]) + slot % kLanes;
  });
}

void Shard::restore(const States& committed_states, const States* trial, std::uint64_t state_version) {
  check_states(committed_states, nodes_.size());
  if (trial != nullptr) check_states(*trial, nodes_.size());
  rollback();
  put_states(committed_states, false);
  state_version_ = state_version;
  if (trial == nullptr) return;
  for (const std::uint32_t row : trial->rows) touched_.push_back(tile_of(nodes_.slot_of(row)));
  std::sort(touched_.begin(), touched_.end());
  touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
  // Lanes beyond the last node: whatever they hold, no node's answer depends on it, but it must be a state.
  for (const std::uint32_t tile : touched_)
    std::copy_n(committed(tile), model_.layout().doubles, buffer(tile, 1U - committed_[tile]));
  put_states(*trial, true);
  has_trial_ = true;
}

}  // namespace shearbus::shard
