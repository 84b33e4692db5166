#include "server/shard/shard.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <functional>
#include <iterator>
#include <limits>
#include <mutex>
#include <optional>

#include "server/physics/solver/step_operators.hpp"
#include "server/shard/cut.hpp"

namespace shearbus::shard {

using physics::kLanes;

namespace {

// Size of a block of tiles. Blocks of this size return their memory to the system when they are freed and do not slow a
// step, and one block is copied quickly.
constexpr std::size_t kBlockBytes = std::size_t{256} << 10;

// Memory of a model without its operators [bytes], and numbers of the operators of a step length for each number of a
// node's state, measured.
constexpr std::uint64_t kBytesPerModel = std::uint64_t{4} << 10;
constexpr std::uint64_t kOperatorsPerState = 34;

constexpr double kNodeWork = 32.0;  // work of a node-step that solves nothing, measured roughly  [evaluations]

// Makes these lanes open contacts without forces: all inputs stay 0 except the masses, by which the step divides. No
// answer depends on the values of these masses.
void leave_open(std::uint32_t lanes, physics::TileInputs& in) {
  for (const int lane : physics::lanes_of(lanes)) in.mass_soft[lane] = in.mass_hard[lane] = 1.0;
}

template <typename LaneRows>
void gather(std::span<const double> column, const LaneRows& lanes, double* values) {
  if (lanes.in_order) {
    std::copy_n(column.data() + lanes.row[0], kLanes, values);
    return;
  }
  for (int lane = 0; lane < kLanes; ++lane)
    if (lanes.has(lane)) values[lane] = column[lanes.row[lane]];
}

template <typename From, typename LaneRows, typename To>
void scatter(const From* values, const LaneRows& lanes, std::span<To> column) {
  if (lanes.in_order) {
    To* rows = column.data() + lanes.row[0];
    for (int lane = 0; lane < kLanes; ++lane) rows[lane] = static_cast<To>(values[lane]);
    return;
  }
  for (int lane = 0; lane < kLanes; ++lane)
    if (lanes.has(lane)) column[lanes.row[lane]] = static_cast<To>(values[lane]);
}

template <typename Lane, typename Value>
const Lane* values_of(const AnswerColumn<Lane, Value>& column, const TileAnswers& out, const physics::TileLedger&) {
  return out.*column.member;
}
const double* values_of(const LedgerColumn& column, const TileAnswers&, const physics::TileLedger& ledger) {
  return ledger.term[static_cast<std::size_t>(column.term)];
}

// Adds the heat of a step to what the friction of each node has given to the bodies. A step that failed gave nothing.
void sum_energy(const TileStates& layout, std::uint32_t active, physics::TileLedger& ledger, const double* from,
                double* to, TileAnswers& out) {
  constexpr physics::LedgerTerm kTerms[] = {physics::LedgerTerm::kHeatToSoft, physics::LedgerTerm::kHeatToHard};
  double(*const sums[])[kLanes] = {&out.friction_energy_soft, &out.friction_energy_hard};
  for (std::size_t side = 0; side < 2; ++side) {
    const std::size_t at = layout.friction_energy + side * kLanes;
    std::copy_n(from + at, kLanes, to + at);
    for (const int lane : physics::lanes_of(active)) {
      const auto l = static_cast<std::size_t>(lane);
      if ((out.outcome[lane] & physics::kFailed) == 0) to[at + l] = from[at + l] + ledger(kTerms[side], lane);
      (*sums[side])[lane] = to[at + l];
    }
  }
}

}  // namespace

std::uint64_t Shard::bytes_per_node(const TileStates& layout) {
  // Memory of a node in NodeTable, touched_ and row_of_slot_.
  constexpr std::uint64_t kLists = NodeTable::kBytesPerNode + 2 * sizeof(std::uint32_t);
  return 2 * sizeof(double) * layout.doubles / kLanes + kLists;
}

std::uint64_t Shard::bytes_with(std::size_t nodes, const PairsOfNodes* of_nodes) const {
  if (!pairs_.several() || of_nodes == nullptr) return bytes_for(map_.nodes() + nodes);
  PairTable pairs = pairs_;
  const std::vector<std::uint32_t> places = pairs.add(of_nodes->pairs, map_.nodes_of_pairs(pairs_.size()));
  std::vector<std::uint32_t> of_node;
  for (const std::uint32_t place : of_nodes->of_node) of_node.push_back(places[place]);
  TileMap map = map_;
  map.add(of_node, pairs.size());
  return bytes_of_tiles(layout_, map.tiles()) + bytes_of_pairs(map, pairs.size());
}

std::uint64_t Shard::bytes_of_pairs(const TileMap& map, std::size_t pairs) const {
  if (!pairs_.several()) return 0;
  const std::vector<std::size_t> nodes = map.nodes_of_pairs(pairs);
  const auto in_use = static_cast<std::uint64_t>(std::ranges::count_if(nodes, [](std::size_t n) { return n > 0; }));
  return in_use *
         (kBytesPerModel + kOperatorsKeptOfPairs * kOperatorsPerState * sizeof(double) * layout_.doubles / kLanes);
}

Shard::Shard(PairTable pairs, TaskPool& pool, const ShardOptions& options)
    : pairs_(std::move(pairs)),
      layout_(pairs_.model(0), options.check_closure, options.sum_energy),
      map_(pairs_.several()),
      pool_(pool),
      options_(options),
      tiles_per_block_(std::max<std::size_t>(1, kBlockBytes / (sizeof(double) * tile_doubles()))) {}

Shard::Shard(physics::Model model, std::span<const std::uint64_t> node_ids, std::span<const double> initial_temperature,
             TaskPool& pool, const ShardOptions& options)
    : Shard(PairTable(std::move(model)), pool, options) {
  apply(adding(node_ids, initial_temperature));
}

double* Shard::buffer(std::size_t tile, unsigned which) const {
  return blocks_[tile / tiles_per_block_].get() + (tile % tiles_per_block_) * tile_doubles() + which * layout_.doubles;
}

Shard::~Shard() {
  end_cut();
}

std::shared_ptr<Cut> Shard::cut() {
  end_cut();
  std::vector<const double*> blocks;
  for (const Block& block : blocks_) blocks.push_back(block.get());
  // Of a step that is being computed the states do not count yet.
  return cut_ = std::make_shared<Cut>(Cut::Of{layout_, pairs_, map_, nodes_, std::move(blocks), tiles_per_block_,
                                              committed_, has_trial_ ? touched_ : std::vector<std::uint32_t>(),
                                              has_trial_});
}

// Called before tiles move or their memory is freed.
void Shard::end_cut() {
  if (cut_ && cut_.use_count() > 1) cut_->save_all();
  cut_.reset();
}

// The buffer of the tile that is not committed, of which an unread cut may need the states.
double* Shard::trial_to_write(std::size_t tile) const {
  const unsigned which = 1U - committed_[tile];
  if (cut_) cut_->before_write(tile, which);
  return buffer(tile, which);
}

NodeGlance Shard::glance(std::size_t slot) const {
  const physics::TileLayout& layout = model().layout();
  const double* lane = committed_tile(slot).data() + slot % kLanes;
  return {.interface_temperature =
              model_of(slot).interface_temperature(committed_tile(slot).data(), static_cast<int>(slot % kLanes)),
          .shear_stress = lane[layout.shear_stress],
          .regime = static_cast<std::uint8_t>(lane[layout.regime])};
}

void Shard::count_regimes(std::span<std::uint64_t> counts) const {
  const std::size_t regime = model().layout().regime;
  for (std::size_t tile = 0; tile < num_tiles(); ++tile) {
    const double* lanes = committed(tile) + regime;
    for (std::size_t lane = 0; lane < map_.used(tile); ++lane)
      // A state from a file may hold any number.
      if (lanes[lane] >= 0.0 && lanes[lane] < static_cast<double>(counts.size()))
        ++counts[static_cast<std::size_t>(lanes[lane])];
  }
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

std::shared_ptr<const Operators> Shard::operators(double dt) {
  auto found = std::find_if(operators_.begin(), operators_.end(), [&](const auto& kept) { return kept.first == dt; });
  if (found == operators_.end()) {
    auto made = std::make_shared<const Operators>(pairs_, map_.nodes_of_pairs(pairs_.size()), dt);
    if (operators_.size() == (pairs_.several() ? kOperatorsKeptOfPairs : kOperatorsKept)) operators_.pop_back();
    found = operators_.emplace(operators_.end(), dt, std::move(made));
  }
  std::rotate(operators_.begin(), found, found + 1);
  return operators_.front().second;
}

// For each lane (node) of one tile, its row in the request of the step. Only the rows of the lanes `named` are valid.
struct Shard::LaneRows {
  std::uint32_t row[kLanes] = {};
  std::uint32_t named = 0;  // bit i: the node of lane i has a row in the request
  std::uint32_t open = 0;   // bit i: the node of lane i has no row in the request and is stepped as an open contact
  bool in_order = false;    // all lanes are named, and their rows follow each other
  bool has(int lane) const { return (named >> lane & 1U) != 0; }
};

// The arguments of a step that all tiles share.
struct Shard::StepOf {
  std::size_t num_nodes;
  bool rows_are_slots;
  bool others_are_open;
  const Operators& operators;
  const StepColumns& columns;
  bool has_ledger;
  const std::vector<bool>* stepped = nullptr;  // nodes that others_are_open does not mean; null: none
};

// The step of one tile.
struct Shard::TileStep {
  std::size_t tile = 0;
  const double* from = nullptr;
  double* to = nullptr;
  LaneRows lanes;
  double work[kLanes] = {};
  physics::TileInputs in;
  TileAnswers out;
};

class Shard::StepRun {
 public:
  // A tile whose step is divided into substeps, and may be interrupted between them. One for each thread.
  struct Divided {
    TileStep tile;
    std::vector<physics::DividedStep> steps;  // for each pair
    double spent = 0.0;                       // work of the interrupted tile so far
    bool interrupted = false;
  };

  StepRun(const StepOf& step_of, const Rows& of) noexcept : step(step_of), rows(of) {}

  bool done() const {
    return next >= tiles->size() && std::ranges::none_of(divided, [](const auto& seat) { return seat->interrupted; });
  }

  StepOf step;
  const Rows& rows;
  std::optional<Attempt> attempt;                     // absent: a step
  bool extends = false;                               // the attempt is added to the trial
  std::vector<std::uint32_t> touched;                 // memory for the tiles of trial and attempt together
  const std::vector<std::uint32_t>* tiles = nullptr;  // set by begin()
  unsigned threads = 1;
  std::size_t grain = 1;                          // number of tiles that a thread takes at a time
  std::vector<std::unique_ptr<Divided>> divided;  // of a model with a tolerance, for each thread; else empty
  std::atomic<std::size_t> next{0};               // place in `tiles` of the next tile that no thread has taken
  std::mutex counting;
  StepCount count;  // of the tiles that are done
};

// Lists the tiles that hold a node of the step. Also fills row_of_slot_, the row of the request for each slot, unless
// the request has every node and the row of every node equals its slot.
void Shard::find_tiles(const Rows& rows, std::vector<std::uint32_t>& tiles) {
  if (rows.all) {
    for (std::size_t tile = 0; tile < num_tiles(); ++tile) tiles.push_back(static_cast<std::uint32_t>(tile));
    for (std::size_t row = 0; row < nodes_->size() && !nodes_->slots_are_rows(); ++row)
      row_of_slot_[nodes_->slot_of(row)] = static_cast<std::uint32_t>(row);
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

std::shared_ptr<Shard::StepRun> Shard::prepare(const Rows& rows, const Operators& operators, const StepColumns& columns,
                                               std::shared_ptr<StepRun> run) {
  const StepOf step{stepped_nodes(rows), rows.all && nodes_->slots_are_rows(), rows.others_are_open, operators, columns,
                    columns.has_ledger()};
  if (run) {
    std::destroy_at(run.get());
    std::construct_at(run.get(), step, rows);  // throws nothing
  } else {
    run = std::make_shared<StepRun>(step, rows);
  }
  const std::size_t tasks = run->step.num_nodes / std::max<std::size_t>(options_.nodes_per_task, 1);
  run->threads = static_cast<unsigned>(std::clamp<std::size_t>(tasks, 1, pool_.threads()));
  if (!model().options().tolerance) return run;
  for (unsigned seat = 0; seat < run->threads; ++seat) {
    run->divided.push_back(std::make_unique<StepRun::Divided>());
    for (std::size_t pair = 0; pair < pairs_.size(); ++pair)
      run->divided.back()->steps.emplace_back(pairs_.model(pair));
  }
  return run;
}

std::shared_ptr<Shard::StepRun> Shard::prepare_attempt(const Rows& rows, const Operators& operators,
                                                       const StepColumns& columns, bool from_trial) {
  auto run = prepare(rows, operators, columns);
  Attempt& attempt = run->attempt.emplace();
  attempt.tiles.reserve(std::max(num_tiles(), rows.slots.size()));
  attempt.states = make_block(std::min(num_tiles(), run->step.num_nodes) * layout_.doubles);
  run->touched.reserve(num_tiles());
  attempt.start = committed_;
  for (const std::uint32_t tile : touched_)
    if (from_trial) attempt.start[tile] = static_cast<std::uint8_t>(1 - attempt.start[tile]);
  return run;
}

// A tile of the trial starts from its trial states: there the lanes of other nodes have their committed states.
std::shared_ptr<Shard::StepRun> Shard::prepare_extension(const Rows& rows, const Operators& operators,
                                                         const StepColumns& columns, const std::vector<bool>& stepped) {
  auto run = prepare_attempt(rows, operators, columns, true);
  run->step.stepped = &stepped;
  run->extends = true;
  return run;
}

void Shard::begin(StepRun& run) {
  if (cut_ && (cut_->over() || cut_.use_count() == 1)) cut_.reset();
  if (!run.attempt) rollback();
  std::vector<std::uint32_t>& tiles = run.attempt ? run.attempt->tiles : touched_;
  find_tiles(run.rows, tiles);
  run.tiles = &tiles;
  // Nodes differ in cost (a melting node needs more iterations), so each thread gets several ranges. A thread looks
  // after each range whether its slice is over.
  constexpr std::size_t kRangesPerThread = 8;
  constexpr std::size_t kMostTiles = 64;
  if (run.divided.empty())
    run.grain = std::clamp<std::size_t>(tiles.size() / (run.threads * kRangesPerThread), 1, kMostTiles);
}

// The seats of a step are the places of its threads. A thread may take several seats, one after the other.
bool Shard::work(StepRun& run, double work) {
  const auto take_seat = [&](std::size_t seat) { run_seat(run, seat, work); };
  if (run.threads == 1)
    take_seat(0);
  else
    pool_.run(run.threads, std::cref(take_seat));
  if (!run.done()) return false;
  for (const std::uint32_t tile : *run.tiles)
    if (!run.step.rows_are_slots) std::fill_n(row_of_slot_.begin() + std::ptrdiff_t{tile} * kLanes, kLanes, kNoRow);
  return true;
}

void Shard::run_seat(StepRun& run, std::size_t seat, double work) {
  StepCount here;
  StepRun::Divided* divided = run.divided.empty() ? nullptr : run.divided[seat].get();
  TileStep whole;
  TileStep& tile = divided != nullptr ? divided->tile : whole;
  std::size_t at = 0, end = 0;  // places of the tiles that this thread has taken
  double left = work;
  // A thread completes the tiles that it has taken; only a divided step is interrupted, of a tile that was taken alone.
  while (left > 0.0 || at != end) {
    const bool resumes = divided != nullptr && divided->interrupted;
    if (!resumes) {
      if (at == end) {
        at = run.next.fetch_add(run.grain, std::memory_order_relaxed);
        end = std::min(at + run.grain, run.tiles->size());
        if (at >= end) break;
      }
      tile.tile = (*run.tiles)[at];
      tile.from = buffer(tile.tile, run.attempt ? run.attempt->start[tile.tile] : committed_[tile.tile]);
      tile.to = run.attempt ? run.attempt->states.get() + at * layout_.doubles : trial_to_write(tile.tile);
      ++at;
      begin_tile(run.step, tile);
      if (tile.in.active == 0) {
        std::copy_n(tile.from, layout_.doubles, tile.to);
        continue;
      }
    }
    double spent_before = 0.0;
    const std::uint32_t pair = map_.pair_of(tile.tile);
    const physics::StepOperators& operators = run.step.operators.of(pair);
    if (divided == nullptr) {
      pairs_.model(pair).advance(operators, tile.in, tile.from, tile.to, tile.out);
    } else {
      physics::DividedStep& step = divided->steps[pair];
      spent_before = resumes ? divided->spent : 0.0;
      if (!resumes) step.begin(operators, tile.in, tile.from, tile.to, tile.out);
      divided->interrupted = !step.run(left);
      divided->spent = spent_before + left;
      if (divided->interrupted) break;
    }
    const StepCount done = end_tile(run.step, tile);
    here += done;
    // Lanes advance together: a tile takes the time of all its lanes, however few are active.
    left -= (done.work - spent_before) * kLanes / std::popcount(tile.in.active);
  }
  const std::lock_guard lock(run.counting);
  run.count += here;
}

StepCount Shard::count_of(const StepRun& run) {
  return run.count;
}

bool Shard::is_small(const StepRun& run) {
  return !run.attempt && run.divided.empty();
}

void Shard::finish(StepRun& run) {
  if (run.attempt) {
    if (!run.extends) rollback();
    const Attempt& attempt = *run.attempt;
    for (std::size_t i = 0; i < attempt.tiles.size(); ++i)
      std::copy_n(attempt.states.get() + i * layout_.doubles, layout_.doubles, trial_to_write(attempt.tiles[i]));
    std::ranges::set_union(touched_, attempt.tiles, std::back_inserter(run.touched));
    touched_.assign(run.touched.begin(), run.touched.end());
  }
  has_trial_ = true;
}

StepCount Shard::step(const Rows& rows, const Operators& operators, const StepColumns& columns) {
  const auto run = prepare(rows, operators, columns);
  begin(*run);
  while (!work(*run, std::numeric_limits<double>::infinity())) {
  }
  finish(*run);
  return run->count;
}

void Shard::begin_tile(const StepOf& step, TileStep& tile) const {
  LaneRows& lanes = tile.lanes = {};
  int in_order = 0;  // number of named lanes whose row follows that of the first lane as it should
  const auto used = static_cast<int>(map_.used(tile.tile));
  for (int lane = 0; lane < used; ++lane) {
    const std::size_t slot = tile.tile * kLanes + lane;
    const bool has_row = step.rows_are_slots || row_of_slot_[slot] != kNoRow;
    if (!has_row && step.others_are_open && (step.stepped == nullptr || !(*step.stepped)[slot]))
      lanes.open |= 1U << lane;
    if (!has_row) continue;
    lanes.row[lane] = step.rows_are_slots ? static_cast<std::uint32_t>(slot) : row_of_slot_[slot];
    lanes.named |= 1U << lane;
    in_order += lanes.row[lane] == lanes.row[0] + static_cast<std::uint32_t>(lane) ? 1 : 0;
  }
  lanes.in_order = in_order == kLanes;
  physics::TileInputs& in = tile.in = {};
  in.active = lanes.named | lanes.open;
  in.work = tile.work;
  in.wants_mean_stress = step.columns.wants_mean_stress;
  std::fill_n(tile.work, kLanes, kNodeWork);
  leave_open(lanes.open, in);
  for (const InputColumn& column : step.columns.inputs) gather(column.values, lanes, in.*column.member);
}

StepCount Shard::end_tile(const StepOf& step, TileStep& tile) const {
  const TileAnswers& out = tile.out;
  physics::TileLedger ledger;
  const physics::Model& model = pairs_.model(map_.pair_of(tile.tile));
  const physics::StepOperators& operators = step.operators.of(map_.pair_of(tile.tile));
  if (step.columns.wants_tangent) model.linearise(operators, tile.in, tile.from, tile.to, tile.out);
  if (step.columns.wants_time_to_melting) model.predict_melting(operators, tile.in, tile.from, tile.out);
  if (step.has_ledger || layout_.sums_energy())
    model.record_energy(operators, tile.in, out, tile.from, tile.to, ledger);
  if (layout_.sums_energy()) sum_energy(layout_, tile.in.active, ledger, tile.from, tile.to, tile.out);
  for (const OutputColumn& column : step.columns.outputs)
    std::visit([&](const auto& answer) { scatter(values_of(answer, out, ledger), tile.lanes, answer.values); }, column);
  StepCount count;
  for (const int lane : physics::lanes_of(tile.in.active)) {
    if ((out.outcome[lane] & ~physics::kAsleep) != 0) ++count.flagged;
    if ((out.outcome[lane] & physics::kFailed) != 0) ++count.failed;
    if ((out.outcome[lane] & physics::kAsleep) != 0) ++count.asleep;
    if ((out.outcome[lane] & physics::kOverBudget) != 0) ++count.over_budget;
    count.work += tile.work[lane];
  }
  if (layout_.check_closure()) {
    double difference[2][kLanes];
    count.closure = exchange(layout_, {step.operators.dt(), step.columns.host_time}, tile.in, out, tile.lanes.named,
                             tile.lanes.open, tile.lanes.row, tile.from, tile.to, difference);
    for (int component = 0; component < 2; ++component)
      if (const std::span<double> column = step.columns.closure[component]; !column.empty())
        scatter(difference[component], tile.lanes, column);
  }
  return count;
}

StepCount& StepCount::operator+=(const StepCount& other) {
  flagged += other.flagged;
  failed += other.failed;
  asleep += other.asleep;
  over_budget += other.over_budget;
  work += other.work;
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
