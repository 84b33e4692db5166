// States of nodes as named columns with units: the form in which files and other shards store them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "server/physics/solver/model.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::shard {

// One state of the nodes: `width` values per node, [node][width].
struct StateColumn {
  std::string name;   // name with unit: "temperature_k"
  std::string units;  // unit: "K"
  std::size_t width = 0;
  std::vector<double> values;
};

struct States {
  std::vector<std::uint32_t> rows;  // rows of the nodes in the node table
  std::vector<StateColumn> columns;
};

class PairTable;
class TileMap;

// States of these rows, whose nodes are in these slots: with the columns that tell their pairs, and room for the states
// that put_state() copies there. `from`: the place in a tile where the states of a node begin.
States blank_states(std::span<const physics::State> known, const PairTable& pairs, const TileMap& map,
                    std::vector<std::uint32_t> rows, std::span<const std::uint32_t> slots);
void put_state(const double* from, std::span<const physics::State> known, std::size_t place, States& states);

// Writes the values of `states` into tiles. `states` must begin with one column for each entry of `known`, in the same
// order, but may lack those that begin at 0; columns that tell the pairs of the nodes may follow, of which no tile has a
// copy; `state_of(i)` points at the place in a tile where the state of node states.rows[i] begins.
template <typename StateOf>
void write_states(const States& states, std::span<const physics::State> known, const StateOf& state_of) {
  auto column = states.columns.begin();
  for (const physics::State& state : known) {
    const bool there = column != states.columns.end() && column->name == state.name;
    for (std::size_t row = 0; row < states.rows.size(); ++row) {
      double* to = state_of(row) + state.offset;
      for (std::size_t i = 0; i < state.width; ++i)
        to[i * physics::kLanes] = there ? column->values[row * state.width + i] : 0.0;
    }
    if (there) ++column;
  }
}

}  // namespace shearbus::shard
