#include "server/shard/tile_map.hpp"

#include <map>
#include <numeric>

namespace shearbus::shard {

using physics::kLanes;

namespace {

constexpr std::uint32_t kNoTile = 0xffffffff;

}  // namespace

std::vector<std::size_t> TileMap::nodes_of_pairs(std::size_t pairs) const {
  std::vector<std::size_t> nodes(pairs, 0);
  if (!several_) nodes.at(0) = nodes_;
  for (std::size_t tile = 0; several_ && tile < pair_.size(); ++tile) nodes.at(pair_[tile]) += used_[tile];
  return nodes;
}

std::vector<std::uint32_t> TileMap::add(std::span<const std::uint32_t> pair_of_node, std::size_t pairs) {
  std::vector<std::uint32_t> slots(pair_of_node.size());
  if (!several_) {
    std::iota(slots.begin(), slots.end(), static_cast<std::uint32_t>(nodes_));
    nodes_ += slots.size();
    return slots;
  }
  std::vector<std::uint32_t> open(pairs, kNoTile);  // for each pair its tile with free lanes
  for (std::uint32_t tile = 0; tile < pair_.size(); ++tile)
    if (used_[tile] < kLanes) open[pair_[tile]] = tile;
  for (std::size_t i = 0; i < slots.size(); ++i) {
    std::uint32_t& tile = open.at(pair_of_node[i]);
    if (tile == kNoTile) {
      tile = static_cast<std::uint32_t>(pair_.size());
      pair_.push_back(pair_of_node[i]);
      used_.push_back(0);
    }
    slots[i] = tile * kLanes + used_[tile];
    if (++used_[tile] == kLanes) tile = kNoTile;
  }
  nodes_ += slots.size();
  return slots;
}

// The tiles of one pair from which nodes leave, the tile with free lanes last.
struct TileMap::TilesOfPair {
  std::vector<std::uint32_t> tiles;
  std::size_t nodes = 0;
  std::size_t leaving = 0;
  std::uint32_t slot(std::size_t place) const {  // of the node at a place in the order of the tiles
    return tiles[place / kLanes] * kLanes + static_cast<std::uint32_t>(place % kLanes);
  }
};

// Moves the last nodes of a pair into the slots of those that leave.
void TileMap::close_gaps(const TilesOfPair& of, Change& change) {
  const std::size_t left = of.nodes - of.leaving;
  std::size_t hole = 0;
  for (std::size_t from = left; from < of.nodes; ++from) {
    if (change.slot_now[of.slot(from)] == kGone) continue;
    while (change.slot_now[of.slot(hole)] != kGone) ++hole;
    change.moves.push_back({of.slot(from), of.slot(hole)});
    change.slot_now[of.slot(from)] = of.slot(hole++);
  }
  for (std::size_t i = 0; several_ && i < of.tiles.size(); ++i)
    used_[of.tiles[i]] =
        static_cast<std::uint8_t>(left > i * kLanes ? std::min<std::size_t>(kLanes, left - i * kLanes) : 0);
}

// Moves the last tiles into the places of empty ones, with all lanes: those without a node need valid states, too.
void TileMap::close_tiles(Change& change) {
  const auto left =
      static_cast<std::uint32_t>(std::ranges::count_if(used_, [](std::uint8_t used) { return used > 0; }));
  std::vector<std::uint32_t> tile_now(pair_.size());
  std::iota(tile_now.begin(), tile_now.end(), 0U);
  std::uint32_t hole = 0;
  for (std::uint32_t tile = left; tile < pair_.size(); ++tile) {
    if (used_[tile] == 0) continue;
    while (used_[hole] != 0) ++hole;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane)
      change.moves.push_back({tile * kLanes + lane, hole * kLanes + lane});
    pair_[hole] = pair_[tile];
    used_[hole] = used_[tile];
    tile_now[tile] = hole;
  }
  pair_.resize(left);
  used_.resize(left);
  for (std::uint32_t& slot : change.slot_now)
    if (slot != kGone) slot = tile_now[slot / kLanes] * kLanes + slot % kLanes;
}

TileMap::Change TileMap::remove(std::span<const std::uint32_t> slots) {
  Change change;
  change.slot_now.resize(tiles() * kLanes);
  std::iota(change.slot_now.begin(), change.slot_now.end(), 0U);
  std::map<std::uint32_t, TilesOfPair> pairs;
  for (const std::uint32_t slot : slots) {
    change.slot_now[slot] = kGone;
    ++pairs[pair_of(slot / kLanes)].leaving;
  }
  for (std::uint32_t tile = 0; tile < tiles(); ++tile) {
    const auto affected = pairs.find(pair_of(tile));
    if (affected == pairs.end()) continue;
    affected->second.tiles.push_back(tile);
    affected->second.nodes += used(tile);
  }
  for (auto& [pair, of] : pairs) {
    std::stable_partition(of.tiles.begin(), of.tiles.end(), [&](std::uint32_t tile) { return used(tile) == kLanes; });
    close_gaps(of, change);
  }
  nodes_ -= slots.size();
  if (several_) close_tiles(change);
  return change;
}

}  // namespace shearbus::shard
