#include "server/shard/shard.hpp"

#include <algorithm>
#include <atomic>
#include <functional>
#include <limits>

namespace shearbus::shard {

using physics::kLanes;

namespace {

constexpr std::uint32_t kNoRow = std::numeric_limits<std::uint32_t>::max();

// The rows of a request that belong to one tile.
struct LaneRows {
  std::uint32_t row[kLanes];
  std::uint32_t active = 0;
};

void gather(std::span<const double> column, const LaneRows& lanes, double* values) {
  if (column.empty()) return;
  for (int lane = 0; lane < kLanes; ++lane)
    if (lanes.row[lane] != kNoRow) values[lane] = column[lanes.row[lane]];
}

template <typename From, typename To>
void scatter(const From* values, const LaneRows& lanes, std::span<To> column) {
  if (column.empty()) return;
  for (int lane = 0; lane < kLanes; ++lane)
    if (lanes.row[lane] != kNoRow) column[lanes.row[lane]] = static_cast<To>(values[lane]);
}

}  // namespace

std::uint64_t Shard::bytes_per_node(const physics::Model& model) {
  return 2 * sizeof(double) * model.layout().doubles / kLanes;
}

std::uint64_t Shard::bytes_for(const physics::Model& model, std::size_t nodes) {
  return (nodes + kLanes - 1) / kLanes * (kLanes * bytes_per_node(model));
}

Shard::Shard(physics::Model model, std::vector<std::uint64_t> node_ids, std::span<const double> initial_temperature,
             TaskPool& pool, const ShardOptions& options)
    : model_(std::move(model)), nodes_(std::move(node_ids)), pool_(pool), options_(options) {
  states_.reset(static_cast<double*>(::operator new[](state_bytes(), std::align_val_t{64})));
  committed_.assign(num_tiles(), 0);
  touched_.reserve(nodes_.size());  // so that a step allocates nothing
  row_of_slot_.assign(num_tiles() * kLanes, kNoRow);
  for (std::size_t tile = 0; tile < num_tiles(); ++tile) {
    double temperature[kLanes];
    for (int lane = 0; lane < kLanes; ++lane) {
      const std::size_t slot =
          std::min(tile * kLanes + lane, nodes_.size() - 1);  // lanes beyond the last node repeat it
      temperature[lane] = initial_temperature[slot];
    }
    model_.initialise(buffer(tile, 0), temperature);
  }
}

double* Shard::buffer(std::size_t tile, unsigned which) const {
  return states_.get() + (2 * tile + which) * model_.layout().doubles;
}

std::span<const double> Shard::committed_tile(std::size_t slot) const {
  const std::size_t tile = slot / kLanes;
  return {buffer(tile, committed_[tile]), model_.layout().doubles};
}

std::shared_ptr<const physics::StepOperators> Shard::operators(double dt) {
  auto found = std::find_if(operators_.begin(), operators_.end(), [&](const auto& kept) { return kept.first == dt; });
  if (found == operators_.end()) {
    auto made = model_.operators(dt);
    if (operators_.size() == kOperatorsKept) operators_.pop_back();
    found = operators_.emplace(operators_.end(), dt, std::move(made));
  }
  std::rotate(operators_.begin(), found, found + 1);
  return operators_.front().second;
}

std::uint64_t Shard::step(const Rows& rows, const physics::StepOperators& operators, const StepInputs& inputs,
                          const StepOutputs& outputs) {
  rollback();
  // 1. the tiles that hold a requested node
  const std::size_t num_rows = rows.all ? nodes_.size() : rows.slots.size();
  if (rows.all) {
    for (std::size_t tile = 0; tile < num_tiles(); ++tile) touched_.push_back(static_cast<std::uint32_t>(tile));
  } else {
    for (std::size_t row = 0; row < num_rows; ++row) {
      row_of_slot_[rows.slots[row]] = static_cast<std::uint32_t>(row);
      touched_.push_back(rows.slots[row] / kLanes);
    }
    std::sort(touched_.begin(), touched_.end());
    touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
  }

  // 2. each of them on its own, by one thread or several: no tile looks at another
  std::atomic<std::uint64_t> flagged{0};
  const auto step_range = [&](std::size_t first, std::size_t last) {
    std::uint64_t flagged_here = 0;
    for (std::size_t i = first; i < last; ++i)
      flagged_here += step_tile(touched_[i], rows.all, operators, inputs, outputs);
    flagged.fetch_add(flagged_here, std::memory_order_relaxed);
  };
  const std::size_t tasks = num_rows / std::max<std::size_t>(options_.nodes_per_task, 1);
  if (tasks <= 1) {
    step_range(0, touched_.size());
  } else {
    // Nodes differ in cost (a melting one needs more iterations), so each thread comes back for several ranges.
    constexpr std::size_t kRangesPerThread = 8;
    const auto threads = static_cast<unsigned>(std::min<std::size_t>(tasks, pool_.threads()));
    const std::size_t grain = std::max<std::size_t>(1, touched_.size() / (threads * kRangesPerThread));
    pool_.run(touched_.size(), grain, threads, std::cref(step_range));
  }

  for (const std::uint32_t slot : rows.slots) row_of_slot_[slot] = kNoRow;
  has_trial_ = true;
  return flagged;
}

std::uint64_t Shard::step_tile(std::size_t tile, bool all_rows, const physics::StepOperators& operators,
                               const StepInputs& inputs, const StepOutputs& outputs) {
  LaneRows lanes;
  for (int lane = 0; lane < kLanes; ++lane) {
    const std::size_t slot = tile * kLanes + lane;
    const bool has_node = slot < nodes_.size();
    lanes.row[lane] = all_rows ? (has_node ? static_cast<std::uint32_t>(slot) : kNoRow) : row_of_slot_[slot];
    if (lanes.row[lane] != kNoRow) lanes.active |= 1U << lane;
  }

  physics::TileInputs in;
  in.active = lanes.active;
  gather(inputs.velocity_jump, lanes, in.velocity_jump);
  gather(inputs.pressure, lanes, in.pressure);
  gather(inputs.soft_shear_rate, lanes, in.soft_shear_rate);
  gather(inputs.stress_minus, lanes, in.stress_minus);
  gather(inputs.stress_plus, lanes, in.stress_plus);
  gather(inputs.mass_minus, lanes, in.mass_minus);
  gather(inputs.mass_plus, lanes, in.mass_plus);
  gather(inputs.soft_plastic_rate, lanes, in.soft_plastic_rate);

  physics::TileOutputs out;
  const unsigned committed = committed_[tile];
  model_.advance(operators, in, buffer(tile, committed), buffer(tile, 1 - committed), out);

  scatter(out.shear_stress, lanes, outputs.shear_stress);
  scatter(out.sliding_velocity, lanes, outputs.sliding_velocity);
  scatter(out.interface_temperature, lanes, outputs.interface_temperature);
  scatter(out.velocity_jump_new, lanes, outputs.velocity_jump_new);
  scatter(out.friction_heat, lanes, outputs.friction_heat);
  scatter(out.regime, lanes, outputs.regime);
  scatter(out.outcome, lanes, outputs.outcome);

  std::uint64_t flagged = 0;
  for (int lane = 0; lane < kLanes; ++lane)
    if (lanes.row[lane] != kNoRow && out.outcome[lane] != 0) ++flagged;
  return flagged;
}

void Shard::commit() {
  for (const std::uint32_t tile : touched_) committed_[tile] = static_cast<std::uint8_t>(1 - committed_[tile]);
  rollback();
  ++state_version_;
}

void Shard::rollback() {
  touched_.clear();
  has_trial_ = false;
}

}  // namespace shearbus::shard
