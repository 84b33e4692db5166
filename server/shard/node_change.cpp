// Changes of the set of nodes. All work that is slow or can fail is done when the change is prepared.
#include <algorithm>
#include <numeric>
#include <utility>

#include "server/shard/shard.hpp"

namespace shearbus::shard {

using physics::kLanes;

namespace {

void copy_lane(const double* from, double* to, std::size_t doubles, std::size_t from_lane, std::size_t to_lane) {
  for (std::size_t i = 0; i < doubles; i += kLanes) to[i + to_lane] = from[i + from_lane];
}

}  // namespace

// Number of tiles in the block with this index, if the shard has `tiles` tiles.
std::size_t Shard::tiles_in_block(std::size_t block, std::size_t tiles) const {
  return std::min(tiles - block * tiles_per_block_, tiles_per_block_);
}

void Shard::size_lists(NodeChange& change) const {
  const std::size_t tiles = change.map_.tiles();
  change.committed_.reserve(tiles);
  change.committed_.assign(committed_.begin(),
                           committed_.begin() + static_cast<std::ptrdiff_t>(std::min(tiles, committed_.size())));
  change.committed_.resize(tiles, 0);
  change.touched_.reserve(change.nodes_->size());  // reserved here, so that a step allocates nothing
  change.row_of_slot_.assign(tiles * kLanes, kNoRow);
}

// Adds the pairs of new nodes to the table of the change, and the nodes to its map and list. Returns their slots.
std::vector<std::uint32_t> Shard::place(std::span<const std::uint64_t> node_ids, const PairsOfNodes* pairs,
                                        NodeChange& change) const {
  std::vector<std::uint32_t> of_node(node_ids.size(), 0);
  change.map_ = map_;
  if (pairs_.several()) {
    change.pairs_ = pairs_;
    if (pairs != nullptr) {
      const auto places = change.pairs_->add(pairs->pairs, map_.nodes_of_pairs(pairs_.size()));
      for (std::size_t i = 0; i < of_node.size(); ++i) of_node[i] = places[pairs->of_node[i]];
    }
  }
  std::vector<std::uint32_t> slots = change.map_.add(of_node, change.pairs_ ? change.pairs_->size() : 1);
  change.nodes_ = std::make_shared<const NodeTable>(nodes_->with(node_ids, slots));
  return slots;
}

Shard::NodeChange Shard::adding(std::span<const std::uint64_t> node_ids, std::span<const double> temperature,
                                const States* states, const PairsOfNodes* pairs) const {
  const std::size_t doubles = layout_.doubles;
  if (states != nullptr) check_states(*states, node_ids.size());
  NodeChange change;
  const std::vector<std::uint32_t> slots = place(node_ids, pairs, change);
  const std::size_t tiles = change.map_.tiles();
  size_lists(change);

  // 1. allocate the blocks of the new tiles; the first of them may hold old tiles, too
  change.first_block_ = num_tiles() / tiles_per_block_;
  change.blocks_.resize((tiles + tiles_per_block_ - 1) / tiles_per_block_);
  if (tiles == num_tiles()) change.first_block_ = change.blocks_.size();
  for (std::size_t block = change.first_block_; block < change.blocks_.size(); ++block)
    change.blocks_[block] = make_tiles(tiles_in_block(block, tiles));
  const auto tile_at = [&](std::size_t tile) {
    const std::size_t block = tile / tiles_per_block_;
    if (block < change.first_block_) return committed(tile);  // a free lane there belongs to nobody
    return change.blocks_[block].get() + tile % tiles_per_block_ * tile_doubles() + change.committed_[tile] * doubles;
  };
  for (std::size_t tile = change.first_block_ * tiles_per_block_; tile < num_tiles(); ++tile)
    std::copy_n(committed(tile), doubles, tile_at(tile));

  // 2. initialise the states of new nodes, tile by tile; old nodes keep their states in a tile that both share
  std::vector<std::uint32_t> by_slot(slots.size());
  std::iota(by_slot.begin(), by_slot.end(), 0U);
  std::ranges::sort(by_slot, {}, [&](std::uint32_t i) { return slots[i]; });
  std::vector<double> fresh(doubles);
  for (std::size_t i = 0; i < by_slot.size();) {
    const std::size_t tile = slots[by_slot[i]] / kLanes;
    const std::size_t first = slots[by_slot[i]] % kLanes;
    double initial[kLanes];
    std::fill_n(initial, kLanes, temperature[by_slot[i]]);
    for (; i < by_slot.size() && slots[by_slot[i]] / kLanes == tile; ++i)  // lanes without a node repeat the last node
      std::fill(initial + slots[by_slot[i]] % kLanes, initial + kLanes, temperature[by_slot[i]]);
    const PairTable& table = change.pairs_ ? *change.pairs_ : pairs_;
    table.model(change.map_.pair_of(tile)).initialise(fresh.data(), initial);
    layout_.begin_exchange(fresh.data());
    for (std::size_t lane = first; lane < kLanes; ++lane) copy_lane(fresh.data(), tile_at(tile), doubles, lane, lane);
  }
  if (states != nullptr)
    write_states(*states, layout_.states(), [&](std::size_t row) {
      const std::size_t slot = slots[states->rows[row]];
      return tile_at(slot / kLanes) + slot % kLanes;
    });
  return change;
}

Shard::NodeChange Shard::removing(std::span<const std::uint32_t> slots) const {
  NodeChange change;
  change.map_ = map_;
  TileMap::Change gone = change.map_.remove(slots);
  change.nodes_ = std::make_shared<const NodeTable>(nodes_->moved(gone.slot_now));
  change.moves_ = std::move(gone.moves);
  const std::size_t tiles = change.map_.tiles();
  size_lists(change);
  change.blocks_.resize((tiles + tiles_per_block_ - 1) / tiles_per_block_);
  change.first_block_ = change.blocks_.size();
  if (tiles == num_tiles() || tiles % tiles_per_block_ == 0) return change;
  --change.first_block_;
  change.copied_tiles_ = tiles_in_block(change.first_block_, tiles);
  change.blocks_.back() = make_tiles(change.copied_tiles_);
  return change;
}

void Shard::apply(NodeChange&& change) {
  end_cut();
  const std::size_t doubles = layout_.doubles;
  for (const auto& [from, to] : change.moves_)
    copy_lane(committed(from / kLanes), committed(to / kLanes), doubles, from % kLanes, to % kLanes);
  for (std::size_t i = 0; i < change.copied_tiles_; ++i) {
    const std::size_t tile = change.first_block_ * tiles_per_block_ + i;
    std::copy_n(committed(tile), doubles,
                change.blocks_.back().get() + i * tile_doubles() + committed_[tile] * doubles);
  }
  for (std::size_t block = 0; block < change.first_block_; ++block) change.blocks_[block] = std::move(blocks_[block]);
  blocks_ = std::move(change.blocks_);
  nodes_ = std::move(change.nodes_);
  map_ = std::move(change.map_);
  if (change.pairs_) {  // the operators may lack those of a pair that now has nodes
    pairs_ = std::move(*change.pairs_);
    operators_.clear();
  }
  committed_ = std::move(change.committed_);
  touched_ = std::move(change.touched_);
  row_of_slot_ = std::move(change.row_of_slot_);
}

}  // namespace shearbus::shard
