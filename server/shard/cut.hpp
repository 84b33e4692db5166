// The states of a shard at one moment, read on another thread while the shard goes on. Nothing is copied when the cut is
// made: the reader takes each tile from where it lies, and the shard saves a tile that is not read yet before it
// overwrites it. Steps write to the buffer that is not committed, so the first step after the cut saves nothing.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "server/shard/block.hpp"
#include "server/shard/closure.hpp"
#include "server/shard/node_table.hpp"
#include "server/shard/pairs.hpp"
#include "server/shard/states.hpp"
#include "server/shard/tile_map.hpp"

namespace shearbus::shard {

class Cut {
 public:
  // What the shard consists of at the moment of the cut.
  struct Of {
    TileStates layout;
    PairTable pairs;
    TileMap map;
    std::shared_ptr<const NodeTable> nodes;
    std::vector<const double*> blocks;  // first state of each block of tiles (Shard::blocks_)
    std::size_t tiles_per_block;
    std::vector<std::uint8_t> committed;  // number of the buffer with the committed states, for each tile
    std::vector<std::uint32_t> touched;   // tiles with trial states, ascending; empty without a trial
    bool has_trial;
  };
  explicit Cut(Of of);

  struct Contents {
    std::vector<std::uint64_t> node_ids;
    States committed;             // of every node
    std::optional<States> trial;  // of the nodes in tiles that the trial changed; absent without a trial
  };
  // Called once, on any thread.
  Contents read();

  // Called by the shard before it writes to this buffer (0 or 1) of the tile.
  void before_write(std::size_t tile, unsigned buffer) {
    if (buffer == of_.committed[tile] || has_trial(tile)) save(tile);
  }
  void save_all();  // called before tiles move or their memory is freed
  bool over() const { return over_.load(std::memory_order_acquire); }  // whether read() has ended

 private:
  enum State : std::uint8_t { kInPlace, kTaken, kSaved, kRead };

  bool has_trial(std::size_t tile) const;
  const double* in_place(std::size_t tile, bool of_trial) const;
  double* saved(std::size_t tile, bool of_trial) const;
  void save(std::size_t tile);
  bool take(std::size_t tile);
  States blank(std::vector<std::uint32_t> rows) const;

  Of of_;
  std::unique_ptr<std::atomic<std::uint8_t>[]> tiles_;  // State of each tile
  Block committed_;  // saved states: [tile][TileStates::doubles]; no memory is used for tiles that are not saved
  Block trial_;      // likewise, for the tiles of of_.touched
  std::atomic<bool> over_{false};
};

}  // namespace shearbus::shard
