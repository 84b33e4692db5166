// Changes of the set of nodes. All work that is slow or can fail is done when the change is prepared.
#include <sys/mman.h>

#include <algorithm>
#include <new>
#include <tuple>
#include <utility>

#include "server/shard/shard.hpp"

namespace shearbus::shard {

using physics::kLanes;

namespace {

constexpr std::align_val_t kAlignment{64};
constexpr std::size_t kMappedFrom = std::size_t{128} << 10;  // smallest block that is allocated with mmap  [bytes]

void copy_lane(const double* from, double* to, std::size_t doubles, std::size_t from_lane, std::size_t to_lane) {
  for (std::size_t i = 0; i < doubles; i += kLanes) to[i + to_lane] = from[i + from_lane];
}

}  // namespace

// Large blocks are mapped with mmap, because munmap returns their memory to the system at once; a heap may keep it.
Shard::Block Shard::make_states(std::size_t doubles) {
  const std::size_t bytes = doubles * sizeof(double);
  if (bytes < kMappedFrom) return Block(static_cast<double*>(::operator new[](bytes, kAlignment)));
  void* pages = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (pages == MAP_FAILED) throw std::bad_alloc();
  return Block(static_cast<double*>(pages), {.mapped_bytes = bytes});
}

void Shard::Release::operator()(double* p) const {
  if (mapped_bytes == 0)
    ::operator delete[](p, kAlignment);
  else
    ::munmap(p, mapped_bytes);
}

// Number of tiles in the block with this index, if the shard has `tiles` tiles.
std::size_t Shard::tiles_in_block(std::size_t block, std::size_t tiles) const {
  return std::min(tiles - block * tiles_per_block_, tiles_per_block_);
}

void Shard::size_lists(std::size_t nodes, NodeChange& change) const {
  const std::size_t tiles = tiles_for(nodes);
  change.committed_.reserve(tiles);
  change.committed_.assign(committed_.begin(),
                           committed_.begin() + static_cast<std::ptrdiff_t>(std::min(tiles, committed_.size())));
  change.committed_.resize(tiles, 0);
  change.touched_.reserve(nodes);  // reserved here, so that a step allocates nothing
  change.row_of_slot_.assign(tiles * kLanes, kNoRow);
}

Shard::NodeChange Shard::adding(std::span<const std::uint64_t> node_ids, std::span<const double> temperature,
                                const States* states) const {
  const std::size_t before = nodes_.size();
  const std::size_t after = before + node_ids.size();
  const std::size_t tiles = tiles_for(after);
  const std::size_t doubles = layout_.doubles;
  if (states != nullptr) check_states(*states, node_ids.size());
  NodeChange change;
  change.nodes_ = nodes_.with(node_ids);
  size_lists(after, change);

  // 1. allocate the block of the first new state and the blocks after it
  change.first_block_ = before / kLanes / tiles_per_block_;
  change.blocks_.resize((tiles + tiles_per_block_ - 1) / tiles_per_block_);
  for (std::size_t block = change.first_block_; block < change.blocks_.size(); ++block)
    change.blocks_[block] = make_block(tiles_in_block(block, tiles));
  const auto tile_at = [&](std::size_t tile) {
    return change.blocks_[tile / tiles_per_block_].get() + tile % tiles_per_block_ * tile_doubles() +
           change.committed_[tile] * doubles;
  };
  for (std::size_t tile = change.first_block_ * tiles_per_block_; tile < num_tiles(); ++tile)
    std::copy_n(committed(tile), doubles, tile_at(tile));
  if (node_ids.empty()) return change;

  // 2. initialise the states of new nodes; old nodes keep their states in a tile that old and new nodes share
  std::vector<double> fresh(doubles);
  for (std::size_t tile = before / kLanes; tile < tiles; ++tile) {
    double initial[kLanes];
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const std::size_t slot =
          std::clamp(tile * kLanes + lane, before, after - 1);  // lanes without a node repeat the last node
      initial[lane] = temperature[slot - before];
    }
    model_.initialise(fresh.data(), initial);
    layout_.begin_exchange(fresh.data());
    for (std::size_t lane = tile * kLanes < before ? before % kLanes : 0; lane < kLanes; ++lane)
      copy_lane(fresh.data(), tile_at(tile), doubles, lane, lane);
  }
  if (states != nullptr)
    write_states(*states, layout_.states(), [&](std::size_t row) {
      const std::size_t slot = before + states->rows[row];
      return tile_at(slot / kLanes) + slot % kLanes;
    });
  return change;
}

Shard::NodeChange Shard::removing(std::span<const std::uint32_t> slots) const {
  NodeChange change;
  std::tie(change.nodes_, change.moves_) = nodes_.without(slots);
  const std::size_t tiles = tiles_for(change.nodes_.size());
  size_lists(change.nodes_.size(), change);
  change.blocks_.resize((tiles + tiles_per_block_ - 1) / tiles_per_block_);
  change.first_block_ = change.blocks_.size();
  if (tiles == num_tiles() || tiles % tiles_per_block_ == 0) return change;
  --change.first_block_;
  change.copied_tiles_ = tiles_in_block(change.first_block_, tiles);
  change.blocks_.back() = make_block(change.copied_tiles_);
  return change;
}

void Shard::apply(NodeChange&& change) {
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
  committed_ = std::move(change.committed_);
  touched_ = std::move(change.touched_);
  row_of_slot_ = std::move(change.row_of_slot_);
}

}  // namespace shearbus::shard
