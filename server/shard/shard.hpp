// A shard owns the committed and trial states of the nodes of one session and steps them. It knows node ids and slots,
// but no messages, sessions or clock.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "server/physics/solver/model.hpp"
#include "server/physics/solver/tile.hpp"
#include "server/shard/block.hpp"
#include "server/shard/closure.hpp"
#include "server/shard/node_table.hpp"
#include "server/shard/pairs.hpp"
#include "server/shard/states.hpp"
#include "server/shard/step_columns.hpp"
#include "server/shard/task_pool.hpp"
#include "server/shard/tile_map.hpp"

namespace shearbus::shard {

class Cut;

// Numbers of nodes in a step, by outcome.
struct StepCount {
  std::uint64_t flagged = 0;      // nodes with an outcome bit other than kAsleep
  std::uint64_t failed = 0;       // flagged nodes for which the solver found no answer
  std::uint64_t asleep = 0;       // nodes at rest, which were not solved
  std::uint64_t over_budget = 0;  // failed nodes that needed more work than their budget
  double work = 0.0;              // in evaluations (physics/solver/work.hpp)
  Closure closure;  // differences between sent and answered velocity jumps; set if the shard checks closure

  StepCount& operator+=(const StepCount& other);
};

struct ShardOptions {
  std::size_t nodes_per_task = 512;  // smallest number of nodes per thread if several threads share a step
  // true: force-driven nodes also keep the answered velocity jump and the times of layer and host (closure.hpp)
  bool check_closure = false;
  bool sum_energy = false;  // nodes keep the friction heat that either body has got since they began
};

// The part of a node's committed state that an operator of the server can inspect.
struct NodeGlance {
  double interface_temperature;  // [K]
  double shear_stress;           // [Pa]
  std::uint8_t regime;
};

class Shard {
 public:
  // `initial_temperature` has one value per node [K]. Node ids are unique.
  Shard(physics::Model model, std::span<const std::uint64_t> node_ids, std::span<const double> initial_temperature,
        TaskPool& pool, const ShardOptions& options = {});
  // A shard without nodes yet. A node has the bits that it has in a shard of its pair alone.
  Shard(PairTable pairs, TaskPool& pool, const ShardOptions& options = {});
  Shard(const Shard&) = delete;
  Shard& operator=(const Shard&) = delete;
  ~Shard();  // saves what a cut has not read yet

  // Memory in bytes. bytes_of_state(): the state of one node, as marks and files store it. bytes_per_node(): one node
  // in a shard, which has a committed state, a trial state and an entry in the index. bytes_for(): a number of nodes,
  // in whole tiles. The static function gives the number for a layout of which there is no shard yet.
  static std::uint64_t bytes_per_node(const TileStates& layout);
  std::uint64_t bytes_of_state() const {
    return sizeof(double) * (layout_.doubles / physics::kLanes + pairs_.columns().size());
  }
  std::uint64_t bytes_per_node() const { return bytes_per_node(layout_); }
  std::uint64_t bytes_for(std::size_t nodes) const {
    return bytes_of_tiles(layout_, (nodes + physics::kLanes - 1) / physics::kLanes);
  }
  // Memory of the shard after these nodes have been added, as by adding().
  std::uint64_t bytes_with(std::size_t nodes, const PairsOfNodes* of_nodes) const;

  // The model of the first pair. In all that the columns of a step depend on, the others are equal.
  const physics::Model& model() const { return pairs_.model(0); }
  const physics::Model& model_of(std::size_t slot) const { return pairs_.model(map_.pair_of(slot / physics::kLanes)); }
  const PairTable& pairs() const { return pairs_; }
  std::uint32_t pair_of(std::size_t slot) const { return map_.pair_of(slot / physics::kLanes); }
  const NodeTable& nodes() const { return *nodes_; }
  bool check_closure() const { return layout_.check_closure(); }
  bool sums_energy() const { return layout_.sums_energy(); }
  // One more than the highest slot that may hold a node.
  std::size_t slots() const { return map_.tiles() * physics::kLanes; }
  std::uint64_t state_bytes() const {
    return bytes_of_tiles(layout_, map_.tiles()) + bytes_of_pairs(map_, pairs_.size());
  }
  std::uint64_t state_version() const { return state_version_; }  // number of commits that led to the committed states

  // The operators of a step length [s]. They are factorised at the first use of the length, and the shard keeps the
  // operators of the kOperatorsKept lengths that were used last, with several pairs of fewer.
  std::shared_ptr<const Operators> operators(double dt);

  // Steps the nodes of `rows` from their committed states. The new states are the trial, which replaces any earlier
  // trial. Nodes outside of the step and nodes without an answer keep their states. Throws nothing.
  StepCount step(const Rows& rows, const Operators& operators, const StepColumns& columns);

  // step() in slices, so that the caller can do other things in between. prepare() allocates all that the step needs
  // and changes nothing. After begin(), work() is called until it returns true: each thread of the step computes until
  // it has done about so many evaluations. Until finish() no other member may change the shard, and the arguments of
  // prepare() must live. A run that is abandoned has changed no committed state.
  // `memory`: an earlier run that nobody needs any more, whose memory is used; may be null.
  class StepRun;
  std::shared_ptr<StepRun> prepare(const Rows& rows, const Operators& operators, const StepColumns& columns,
                                   std::shared_ptr<StepRun> memory = nullptr);
  // Prepares a step that changes no state of the shard before finish(). It starts from the trial states if
  // `from_trial`, else from the committed states. finish() then cannot fail; if the step started from a trial, that
  // trial must be committed before.
  std::shared_ptr<StepRun> prepare_attempt(const Rows& rows, const Operators& operators, const StepColumns& columns,
                                           bool from_trial);
  // Prepares the step of further nodes for the standing trial, from their committed states; finish() then adds them to
  // it. stepped[slot]: nodes that the trial has stepped. None of them is a row, and rows.others_are_open does not mean
  // them.
  std::shared_ptr<StepRun> prepare_extension(const Rows& rows, const Operators& operators, const StepColumns& columns,
                                             const std::vector<bool>& stepped);
  void begin(StepRun& run);
  bool work(StepRun& run, double work);
  static StepCount count_of(const StepRun& run);  // of the tiles that are done
  // Whether the run of a step that is over holds no memory except its own, so that it may be kept for prepare().
  static bool is_small(const StepRun& run);
  void finish(StepRun& run);  // makes the new states the trial

  // Number of nodes that a step of these rows includes.
  std::size_t stepped_nodes(const Rows& rows) const {
    return rows.all || rows.others_are_open ? nodes_->size() : rows.slots.size();
  }

  bool has_trial() const { return has_trial_; }
  void commit();    // replaces the committed states by the trial states
  void rollback();  // drops the trial

  NodeGlance glance(std::size_t slot) const;
  // Adds the number of nodes whose committed state is in each regime to `counts`, which has one element per regime.
  void count_regimes(std::span<std::uint64_t> counts) const;

  // Sum of the lengths of a node's steps, with its trial step if there is one  [s]. Only if the shard checks closure.
  double layer_time(std::uint32_t slot) const;

  // Committed states of one node's tile, for tests: [TileStates::doubles].
  std::span<const double> committed_tile(std::size_t slot) const;

  // adding() and removing() prepare a change of the set of nodes without changing the shard; apply() makes the change
  // and cannot fail. The shard must not have a trial. New nodes are added after the present nodes. Each new node starts
  // from a layer of uniform temperature, given in `temperature` [K], or from its row in `states` of another shard, in
  // which row i belongs to node_ids[i]. The new ids must be unique, and the shard must have none of them. `pairs`: of a
  // shard of several pairs, those of the nodes; null: the first pair. adding() throws std::invalid_argument if the states
  // are not of this model.
  class NodeChange;
  NodeChange adding(std::span<const std::uint64_t> node_ids, std::span<const double> temperature,
                    const States* states = nullptr, const PairsOfNodes* pairs = nullptr) const;
  NodeChange removing(std::span<const std::uint32_t> slots) const;
  void apply(NodeChange&& change);

  // The states at this moment, for a reader on another thread while the shard goes on. One at a time: an earlier one that
  // is not read yet is saved now.
  std::shared_ptr<Cut> cut();

  States committed_states() const;  // committed states of every node
  // States of the nodes in these slots, as rows 0, 1, ...; if `of_trial`, the trial states of nodes that have one.
  States states_of(std::span<const std::uint32_t> slots, bool of_trial) const;
  States trial_states() const;  // trial states of the nodes in tiles that the trial changed; empty without a trial
  // Restores the results of committed_states() and trial_states() to the last bit; without `trial` there is no trial.
  // Throws std::invalid_argument if the states do not fit the model and the nodes of this shard.
  void restore(const States& committed_states, const States* trial, std::uint64_t state_version);

  static constexpr std::size_t kOperatorsKept = 8;
  static constexpr std::size_t kOperatorsKeptOfPairs = 2;  // in a shard of several pairs

 private:
  std::size_t num_tiles() const { return map_.tiles(); }
  static std::uint64_t bytes_of_tiles(const TileStates& layout, std::size_t tiles) {
    return tiles * (physics::kLanes * bytes_per_node(layout));
  }
  // Memory of the models and operators of the pairs that have nodes; 0 with one pair, whose share is small.
  std::uint64_t bytes_of_pairs(const TileMap& map, std::size_t pairs) const;
  std::size_t tile_doubles() const { return 2 * layout_.doubles; }
  Block make_tiles(std::size_t tiles) const { return make_block(tiles * tile_doubles()); }
  std::size_t tiles_in_block(std::size_t block, std::size_t tiles) const;
  double* buffer(std::size_t tile, unsigned which) const;
  double* committed(std::size_t tile) const { return buffer(tile, committed_[tile]); }
  static std::uint32_t tile_of(std::uint32_t slot);
  void size_lists(NodeChange& change) const;
  std::vector<std::uint32_t> place(std::span<const std::uint64_t> node_ids, const PairsOfNodes* pairs,
                                   NodeChange& change) const;
  States states_in(std::vector<std::uint32_t> rows, std::span<const std::uint32_t> slots, bool of_trial) const;
  void check_states(const States& states, std::size_t nodes) const;
  void put_states(const States& states, bool of_trial);
  struct Attempt;
  struct StepOf;
  struct TileStep;
  struct LaneRows;
  void find_tiles(const Rows& rows, std::vector<std::uint32_t>& tiles);
  void run_seat(StepRun& run, std::size_t seat, double work);
  void begin_tile(const StepOf& step, TileStep& tile) const;
  StepCount end_tile(const StepOf& step, TileStep& tile) const;
  double* trial_to_write(std::size_t tile) const;
  void end_cut();

  static constexpr std::uint32_t kNoRow = 0xffffffff;

  PairTable pairs_;
  TileStates layout_;
  std::shared_ptr<const NodeTable> nodes_ = std::make_shared<const NodeTable>();
  TileMap map_;
  TaskPool& pool_;
  ShardOptions options_;
  // The tiles are stored in blocks, so that a change of the set of nodes moves few states. The last block has only the
  // tiles it needs.
  std::size_t tiles_per_block_;
  std::vector<Block> blocks_;               // two states per tile: [tile][2][TileStates::doubles]
  std::vector<std::uint8_t> committed_;     // number (0 or 1) of the buffer with the committed states, for each tile
  std::vector<std::uint32_t> touched_;      // numbers of the tiles that the trial changed, ascending
  std::vector<std::uint32_t> row_of_slot_;  // the request's row for the node in each slot, or kNoRow
  bool has_trial_ = false;
  std::uint64_t state_version_ = 0;
  std::shared_ptr<Cut> cut_;  // states that somebody may still read; null: none

  // (step length [s], operators), last used first
  std::vector<std::pair<double, std::shared_ptr<const Operators>>> operators_;
};

struct Shard::Attempt {
  std::vector<std::uint32_t> tiles;
  Block states;                     // states after the step of the tiles in `tiles`: [tile][TileStates::doubles]
  std::vector<std::uint8_t> start;  // number of the buffer from which each tile of the shard starts
};

class Shard::NodeChange {
 private:
  friend class Shard;
  std::shared_ptr<const NodeTable> nodes_;
  TileMap map_;
  std::optional<PairTable> pairs_;  // absent: the pairs stay
  std::vector<Relocation> moves_;   // moves of states, made before the blocks change
  std::size_t first_block_ = 0;     // index of the first block that `blocks_` replaces
  std::vector<Block> blocks_;
  // number of leading tiles of the first new block; they are copied from the old block after the moves
  std::size_t copied_tiles_ = 0;
  std::vector<std::uint8_t> committed_;
  std::vector<std::uint32_t> touched_;
  std::vector<std::uint32_t> row_of_slot_;
};

}  // namespace shearbus::shard
