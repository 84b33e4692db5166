// Which slots hold nodes. A tile holds nodes of one pair of materials only, in its first lanes, and at most one tile of a
// pair has free lanes. In a session with one pair the slots are dense: n nodes occupy the slots 0 to n - 1, and the map
// holds nothing but n.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "server/physics/layer/lanes.hpp"

namespace shearbus::shard {

// The move of a state to another slot.
struct Relocation {
  std::uint32_t from;
  std::uint32_t to;
};

class TileMap {
 public:
  explicit TileMap(bool several_pairs = false) : several_(several_pairs) {}

  std::size_t nodes() const { return nodes_; }
  std::size_t tiles() const { return several_ ? pair_.size() : (nodes_ + physics::kLanes - 1) / physics::kLanes; }
  std::uint32_t pair_of(std::size_t tile) const { return several_ ? pair_[tile] : 0; }
  // Number of nodes in a tile.
  std::size_t used(std::size_t tile) const {
    return several_ ? used_[tile] : std::min<std::size_t>(physics::kLanes, nodes_ - tile * physics::kLanes);
  }
  // Number of nodes of each pair; `pairs`: number of pairs.
  std::vector<std::size_t> nodes_of_pairs(std::size_t pairs) const;

  // Adds nodes of the given pairs, of which there are `pairs`, and returns their slots: first those that are free in a
  // tile of the pair, then those of new tiles.
  std::vector<std::uint32_t> add(std::span<const std::uint32_t> pair_of_node, std::size_t pairs);

  static constexpr std::uint32_t kGone = 0xffffffff;
  struct Change {
    std::vector<std::uint32_t> slot_now;  // for each slot before: where its node is now, or kGone
    std::vector<Relocation> moves;        // of states, to be made in this order
  };
  // Removes the nodes in the given slots. The last nodes of a pair move into the slots that its nodes leave; then the
  // last tiles move into the places of tiles that are empty.
  Change remove(std::span<const std::uint32_t> slots);

 private:
  struct TilesOfPair;
  void close_gaps(const TilesOfPair& of, Change& change);
  void close_tiles(Change& change);

  bool several_;
  std::size_t nodes_ = 0;
  std::vector<std::uint32_t> pair_;  // pair of each tile; empty with one pair
  std::vector<std::uint8_t> used_;   // number of nodes in each tile; empty with one pair
};

}  // namespace shearbus::shard
