// The states of one session's nodes, committed and trial, and the stepping of them. A shard knows node ids and slots;
// it knows no bytes, no sessions and no clock.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <span>
#include <utility>
#include <vector>

#include "server/physics/solver/model.hpp"
#include "server/physics/solver/tile.hpp"
#include "server/shard/node_table.hpp"
#include "server/shard/states.hpp"
#include "server/shard/task_pool.hpp"

namespace shearbus::shard {

// One value per row of the request; an empty column is zero.
struct StepInputs {
  std::span<const double> velocity_jump;        // [m/s]
  std::span<const double> pressure;             // [Pa]
  std::span<const double> soft_shear_rate;      // [1/s]
  std::span<const double> stress_minus;         // [Pa]
  std::span<const double> stress_plus;          // [Pa]
  std::span<const double> mass_minus;           // [kg/m2]
  std::span<const double> mass_plus;            // [kg/m2]
  std::span<const double> soft_plastic_rate{};  // [1/s]
};

// One value per row of the request; an empty column is not wanted.
struct StepOutputs {
  std::span<double> shear_stress;           // [Pa]
  std::span<double> sliding_velocity;       // [m/s]
  std::span<double> interface_temperature;  // [K]
  std::span<double> velocity_jump_new;      // [m/s]
  std::span<double> friction_heat;          // [J/m2]
  std::span<std::uint8_t> regime;
  std::span<std::uint8_t> outcome;
};

struct ShardOptions {
  std::size_t nodes_per_task = 512;  // fewer nodes than this are stepped on the calling thread
};

class Shard {
 public:
  // `initial_temperature` has one value per node [K]. Node ids are unique.
  Shard(physics::Model model, std::vector<std::uint64_t> node_ids, std::span<const double> initial_temperature,
        TaskPool& pool, const ShardOptions& options = {});

  // Memory of one node's states, committed and trial.
  static std::uint64_t bytes_per_node(const physics::Model& model);
  static std::uint64_t bytes_for(const physics::Model& model, std::size_t nodes);

  const physics::Model& model() const { return model_; }
  const NodeTable& nodes() const { return nodes_; }
  std::uint64_t state_bytes() const { return bytes_for(model_, nodes_.size()); }
  std::uint64_t state_version() const { return state_version_; }  // number of commits so far

  // The operators of a step length: factorised at its first use, kept for the next kOperatorsKept lengths.
  std::shared_ptr<const physics::StepOperators> operators(double dt);

  // Steps the nodes of `rows` from their committed states and leaves the answer as the trial, in place of any trial
  // before it. Nodes that are not in `rows` keep their states. Returns the number of nodes whose outcome is not 0.
  // Throws nothing.
  std::uint64_t step(const Rows& rows, const physics::StepOperators& operators, const StepInputs& inputs,
                     const StepOutputs& outputs);

  bool has_trial() const { return has_trial_; }
  void commit();    // the trial becomes the committed states
  void rollback();  // the trial is forgotten

  // Committed states of one node's tile, for tests: [TileLayout::doubles].
  std::span<const double> committed_tile(std::size_t slot) const;

  States committed_states() const;  // of every node
  States trial_states() const;      // of the nodes whose tile the trial touched; none without a trial
  // Puts back what the two above gave, to the last bit; null: no trial stands. Throws std::invalid_argument where they
  // are not of this shard's model and nodes.
  void restore(const States& committed, const States* trial, std::uint64_t state_version);

  static constexpr std::size_t kOperatorsKept = 8;

 private:
  std::size_t num_tiles() const { return (nodes_.size() + physics::kLanes - 1) / physics::kLanes; }
  double* buffer(std::size_t tile, unsigned which) const;
  static std::uint32_t tile_of(std::uint32_t slot);
  States states_in(const std::vector<std::uint32_t>& slots, bool of_trial) const;
  void put_states(const States& states, bool of_trial);
  std::uint64_t step_tile(std::size_t tile, bool all_rows, const physics::StepOperators& operators,
                          const StepInputs& inputs, const StepOutputs& outputs);

  struct AlignedDelete {
    void operator()(double* p) const { ::operator delete[](p, std::align_val_t{64}); }
  };

  physics::Model model_;
  NodeTable nodes_;
  TaskPool& pool_;
  ShardOptions options_;
  std::unique_ptr<double[], AlignedDelete> states_;  // [tile][2][TileLayout::doubles]
  std::vector<std::uint8_t> committed_;     // of each tile: which of its two buffers holds the committed states
  std::vector<std::uint32_t> touched_;      // tiles of the trial
  std::vector<std::uint32_t> row_of_slot_;  // of the step at hand; kNoRow elsewhere
  bool has_trial_ = false;
  std::uint64_t state_version_ = 0;

  std::vector<std::pair<double, std::shared_ptr<const physics::StepOperators>>> operators_;  // most recently used first
};

}  // namespace shearbus::shard
