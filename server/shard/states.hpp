// States of nodes as named columns with units: how they leave a shard and come back, for files and for other shards.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "server/physics/solver/model.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::shard {

// One part of the state: `width` values per node, [node][width].
struct StateColumn {
  std::string name;   // "temperature_k"
  std::string units;  // "K"
  std::size_t width = 0;
  std::vector<double> values;
};

struct States {
  std::vector<std::uint32_t> rows;  // of the node table
  std::vector<StateColumn> columns;
};

// A part of a tile that is a column of its states.
struct StatePart {
  std::string name;
  const char* units;
  std::size_t offset;  // in the tile
  std::size_t width;
};

// The parts of this model's tiles, which together are all of them.
std::vector<StatePart> state_parts(const physics::Model& model);

// Writes the rows of `states`, which has the parts of this model; `state_of(i)` points at the lane of row i in its
// tile.
template <typename StateOf>
void write_states(const States& states, const physics::Model& model, const StateOf& state_of) {
  const std::vector<StatePart> parts = state_parts(model);
  for (std::size_t part = 0; part < parts.size(); ++part)
    for (std::size_t row = 0; row < states.rows.size(); ++row) {
      const std::size_t width = parts[part].width;
      const double* from = states.columns[part].values.data() + row * width;
      double* to = state_of(row) + parts[part].offset;
      for (std::size_t i = 0; i < width; ++i) to[i * physics::kLanes] = from[i];
    }
}

}  // namespace shearbus::shard
