// States of nodes as named columns with units: how they leave a shard and come back, for files and for other shards.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

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
  std::vector<std::uint32_t> slots;  // of the rows
  std::vector<StateColumn> columns;
};

// A part of a tile that is a column of its states.
struct StatePart {
  const char* name;
  const char* units;
  std::size_t offset;  // in the tile
  std::size_t width;
};

// The parts of this layout, which together are all of it.
std::vector<StatePart> state_parts(const physics::TileLayout& layout);

}  // namespace shearbus::shard
