#include "server/shard/shard.hpp"

#include <algorithm>
#include <functional>
#include <iterator>
#include <mutex>

#include "server/physics/solver/step_operators.hpp"

namespace shearbus::shard {

using physics::kLanes;

namespace {

// Size of a block of tiles. Blocks of this size return their memory to the system when they are freed and do not slow a
// step, and one block is copied quickly.
constexpr std::size_t kBlockBytes = std::size_t{256} << 10;

// For each lane of one tile, the row of the request that steps the lane's node. Only the rows of named lanes are valid.
struct LaneRows {
  std::uint32_t row[kLanes] = {};
  std::uint32_t named = 0;  // bit i: the node of lane i has a row
  std::uint32_t open = 0;   // bit i: the node of lane i has no row and is stepped as an open contact
  bool has(int lane) const { return (named >> lane & 1U) != 0; }
};

// Open contacts without forces: the other inputs are 0. No answer depends on these masses, which must be above 0.
void leave_open(std::uint32_t lanes, physics::TileInputs& in) {
  for (const int lane : physics::lanes_of(lanes)) in.mass_soft[lane] = in.mass_hard[lane] = 1.0;
}

void gather(std::span<const double> column, const LaneRows& lanes, double* values) {
  for (int lane = 0; lane < kLanes; ++lane)
    if (lanes.has(lane)) values[lane] = column[lanes.row[lane]];
}

template <typename From, typename To>
void scatter(const From* values, const LaneRows& lanes, std::span<To> column) {
  for (int lane = 0; lane < kLanes; ++lane)
    if (lanes.has(lane)) column[lanes.row[lane]] = static_cast<To>(values[lane]);
}

template <typename Lane, typename Value>
const Lane* values_of(const AnswerColumn<Lane, Value>& column, const physics::TileOutputs& out,
                      const physics::TileLedger&) {
  return out.*column.member;
}
const double* values_of(const LedgerColumn& column, const physics::TileOutputs&, const physics::TileLedger& ledger) {
  return ledger.term[static_cast<std::size_t>(column.term)];
}

}  // namespace

std::uint64_t Shard::bytes_per_node(const physics::Model& model, bool check_closure) {
  // Memory of a node in NodeTable, touched_ and row_of_slot_.
  constexpr std::uint64_t kLists = NodeTable::kBytesPerNode + 2 * sizeof(std::uint32_t);
  return 2 * sizeof(double) * TileStates(model, check_closure).doubles / kLanes + kLists;
}

std::uint64_t Shard::bytes_for(const physics::Model& model, std::size_t nodes, bool check_closure) {
  return tiles_for(nodes) * (kLanes * bytes_per_node(model, check_closure));
}

Shard::Shard(physics::Model model, std::span<const std::uint64_t> node_ids, std::span<const double> initial_temperature,
             TaskPool& pool, const ShardOptions& options)
    : model_(std::move(model)),
      layout_(model_, options.check_closure),
      pool_(pool),
      options_(options),
      tiles_per_block_(std::max<std::size_t>(1, kBlockBytes / (sizeof(double) * tile_doubles()))) {
  apply(adding(node_ids, initial_temperature));
}

double* Shard::buffer(std::size_t tile, unsigned which) const {
  return blocks_[tile / tiles_per_block_].get() + (tile % tiles_per_block_) * tile_doubles() + which * layout_.doubles;
}

NodeGlance Shard::glance(std::size_t slot) const {
  const physics::TileLayout& layout = model_.layout();
  const double* lane = committed_tile(slot).data() + slot % kLanes;
  return {.interface_temperature =
              model_.interface_temperature(committed_tile(slot).data(), static_cast<int>(slot % kLanes)),
          .shear_stress = lane[layout.shear_stress],
          .regime = static_cast<std::uint8_t>(lane[layout.regime])};
}

double Shard::layer_time(std::uint32_t slot) const {
  const std::uint32_t tile = tile_of(slot);
  const bool in_trial = std::binary_search(touched_.begin(), touched_.end(), tile);
  const double* states = buffer(tile, in_trial ? 1U - committed_[tile] : committed_[tile]);
  return states[layout_.layer_time + slot % kLanes];
}

std::span<const double> Shard::committed_tile(std::size_t slot) const {
  return {committed(slot / kLanes), layout_.doubles};
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

// The arguments of a step that all tiles share.
struct Shard::StepOf {
  std::size_t num_nodes;
  bool rows_are_slots;
  bool others_are_open;
  const physics::StepOperators& operators;
  const StepColumns& columns;
  bool has_ledger;
  const std::vector<bool>* stepped = nullptr;  // nodes that others_are_open does not mean; null: none
};

Shard::StepOf Shard::step_of(const Rows& rows, const physics::StepOperators& operators,
                             const StepColumns& columns) const {
  return {stepped_nodes(rows), rows.all && nodes_.slots_are_rows(), rows.others_are_open, operators, columns,
          columns.has_ledger()};
}

// Lists the tiles that hold a node of the step. Also fills row_of_slot_, the row of the request for each slot, unless
// the request has every node and the row of every node equals its slot.
void Shard::find_tiles(const Rows& rows, std::vector<std::uint32_t>& tiles) {
  if (rows.all) {
    for (std::size_t tile = 0; tile < num_tiles(); ++tile) tiles.push_back(static_cast<std::uint32_t>(tile));
    for (std::size_t row = 0; row < nodes_.size() && !nodes_.slots_are_rows(); ++row)
      row_of_slot_[nodes_.slot_of(row)] = static_cast<std::uint32_t>(row);
    return;
  }
  for (std::size_t row = 0; row < rows.slots.size(); ++row) {
    row_of_slot_[rows.slots[row]] = static_cast<std::uint32_t>(row);
    if (!rows.others_are_open) tiles.push_back(tile_of(rows.slots[row]));
  }
  for (std::size_t tile = 0; tile < num_tiles() && rows.others_are_open; ++tile)
    tiles.push_back(static_cast<std::uint32_t>(tile));
  std::sort(tiles.begin(), tiles.end());
  tiles.erase(std::unique(tiles.begin(), tiles.end()), tiles.end());
}

// Steps each tile, on one thread or several; tiles are independent. `from(i)` and `to(i)` are the states of tiles[i]
// before and after the step.
template <typename From, typename To>
StepCount Shard::step_tiles(const StepOf& step, const std::vector<std::uint32_t>& tiles, const From& from,
                            const To& to) {
  StepCount count;
  std::mutex counting;
  const auto step_range = [&](std::size_t first, std::size_t last) {
    StepCount here;
    for (std::size_t i = first; i < last; ++i) here += step_tile(step, tiles[i], from(i), to(i));
    const std::lock_guard lock(counting);
    count += here;
  };
  const std::size_t tasks = step.num_nodes / std::max<std::size_t>(options_.nodes_per_task, 1);
  if (tasks <= 1) {
    step_range(0, tiles.size());
  } else {
    // Nodes differ in cost (a melting node needs more iterations), so each thread gets several ranges.
    constexpr std::size_t kRangesPerThread = 8;
    const auto threads = static_cast<unsigned>(std::min<std::size_t>(tasks, pool_.threads()));
    const std::size_t grain = std::max<std::size_t>(1, tiles.size() / (threads * kRangesPerThread));
    pool_.run(tiles.size(), grain, threads, std::cref(step_range));
  }
  for (const std::uint32_t tile : tiles)
    if (!step.rows_are_slots) std::fill_n(row_of_slot_.begin() + std::ptrdiff_t{tile} * kLanes, kLanes, kNoRow);
  return count;
}

StepCount Shard::step(const Rows& rows, const physics::StepOperators& operators, const StepColumns& columns) {
  rollback();
  find_tiles(rows, touched_);
  const StepOf step = step_of(rows, operators, columns);
  const StepCount count = step_tiles(
      step, touched_, [&](std::size_t i) { return committed(touched_[i]); },
      [&](std::size_t i) { return buffer(touched_[i], 1U - committed_[touched_[i]]); });
  has_trial_ = true;
  return count;
}

Shard::Attempt Shard::attempt(const Rows& rows, const physics::StepOperators& operators, const StepColumns& columns,
                              bool from_trial) {
  const StepOf step = step_of(rows, operators, columns);
  const std::size_t doubles = layout_.doubles;
  Attempt attempt;
  attempt.tiles_.reserve(std::max(num_tiles(), rows.slots.size()));
  attempt.states_ = make_states(std::min(num_tiles(), step.num_nodes) * doubles);
  std::vector<std::uint8_t> begin = committed_;
  for (const std::uint32_t tile : touched_)
    if (from_trial) begin[tile] = static_cast<std::uint8_t>(1 - begin[tile]);
  find_tiles(rows, attempt.tiles_);
  attempt.count = step_tiles(
      step, attempt.tiles_, [&](std::size_t i) { return buffer(attempt.tiles_[i], begin[attempt.tiles_[i]]); },
      [&](std::size_t i) { return attempt.states_.get() + i * doubles; });
  return attempt;
}

void Shard::adopt(const Attempt& attempt) {
  rollback();
  const std::size_t doubles = layout_.doubles;
  for (std::size_t i = 0; i < attempt.tiles_.size(); ++i) {
    const std::uint32_t tile = attempt.tiles_[i];
    touched_.push_back(tile);
    std::copy_n(attempt.states_.get() + i * doubles, doubles, buffer(tile, 1U - committed_[tile]));
  }
  has_trial_ = true;
}

// A tile that the trial has not touched has no trial states yet, so its new states may be written where they belong. A
// tile that earlier rows of the trial share gets its new states in memory of the extension.
Shard::Extension Shard::extend(const Rows& rows, const physics::StepOperators& operators, const StepColumns& columns,
                               const std::vector<bool>& stepped) {
  StepOf step = step_of(rows, operators, columns);
  step.stepped = &stepped;
  const std::size_t doubles = layout_.doubles;
  Extension extension;
  std::vector<std::uint32_t> tiles;
  tiles.reserve(std::max(num_tiles(), rows.slots.size()));
  extension.touched_.reserve(num_tiles());
  extension.shared_.reserve(std::min(num_tiles(), touched_.size()));
  extension.states_ = make_states(extension.shared_.capacity() * doubles);
  find_tiles(rows, tiles);
  std::ranges::set_intersection(touched_, tiles, std::back_inserter(extension.shared_));
  std::ranges::set_union(touched_, tiles, std::back_inserter(extension.touched_));
  const auto place = [&](std::uint32_t tile) {
    const auto found = std::ranges::lower_bound(extension.shared_, tile);
    const bool shared = found != extension.shared_.end() && *found == tile;
    return shared ? extension.states_.get() + (found - extension.shared_.begin()) * static_cast<std::ptrdiff_t>(doubles)
                  : nullptr;
  };
  const auto trial = [&](std::uint32_t tile) { return buffer(tile, 1U - committed_[tile]); };
  extension.count = step_tiles(
      step, tiles, [&](std::size_t i) { return place(tiles[i]) != nullptr ? trial(tiles[i]) : committed(tiles[i]); },
      [&](std::size_t i) {
        double* const apart = place(tiles[i]);
        return apart != nullptr ? apart : trial(tiles[i]);
      });
  return extension;
}

void Shard::adopt(const Extension& extension) {
  const double* from = extension.states_.get();
  for (const std::uint32_t tile : extension.shared_) {
    std::copy_n(from, layout_.doubles, buffer(tile, 1U - committed_[tile]));
    from += layout_.doubles;
  }
  touched_.assign(extension.touched_.begin(), extension.touched_.end());
}

StepCount Shard::step_tile(const StepOf& step, std::size_t tile, const double* from, double* to) const {
  LaneRows lanes;
  for (int lane = 0; lane < kLanes; ++lane) {
    const std::size_t slot = tile * kLanes + lane;
    const bool has_row = step.rows_are_slots ? slot < nodes_.size() : row_of_slot_[slot] != kNoRow;
    if (!has_row && step.others_are_open && slot < nodes_.size() && (step.stepped == nullptr || !(*step.stepped)[slot]))
      lanes.open |= 1U << lane;
    if (!has_row) continue;
    lanes.row[lane] = step.rows_are_slots ? static_cast<std::uint32_t>(slot) : row_of_slot_[slot];
    lanes.named |= 1U << lane;
  }

  physics::TileInputs in;
  in.active = lanes.named | lanes.open;
  if (in.active == 0) {
    std::copy_n(from, layout_.doubles, to);
    return {};
  }
  leave_open(lanes.open, in);
  for (const InputColumn& column : step.columns.inputs) gather(column.values, lanes, in.*column.member);

  physics::TileOutputs out;
  physics::TileLedger ledger;
  model_.advance(step.operators, in, from, to, out);
  if (step.has_ledger) model_.record_energy(step.operators, in, out, from, to, ledger);
  for (const OutputColumn& column : step.columns.outputs)
    std::visit([&](const auto& answer) { scatter(values_of(answer, out, ledger), lanes, answer.values); }, column);
  StepCount count = count_of(out, in.active);
  if (layout_.check_closure()) {
    double difference[2][kLanes];
    count.closure = exchange(layout_, {step.operators.dt(), step.columns.host_time}, in, out, lanes.named, lanes.open,
                             lanes.row, from, to, difference);
    for (int component = 0; component < 2; ++component)
      if (const std::span<double> column = step.columns.closure[component]; !column.empty())
        scatter(difference[component], lanes, column);
  }
  return count;
}

StepCount Shard::count_of(const physics::TileOutputs& out, std::uint32_t active) {
  StepCount count;
  for (const int lane : physics::lanes_of(active)) {
    if ((out.outcome[lane] & ~physics::kAsleep) != 0) ++count.flagged;
    if ((out.outcome[lane] & physics::kFailed) != 0) ++count.failed;
    if ((out.outcome[lane] & physics::kAsleep) != 0) ++count.asleep;
  }
  return count;
}

StepCount& StepCount::operator+=(const StepCount& other) {
  flagged += other.flagged;
  failed += other.failed;
  asleep += other.asleep;
  closure += other.closure;
  return *this;
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
