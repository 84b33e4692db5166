#include "server/shard/cut.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <thread>
#include <utility>

namespace shearbus::shard {

using physics::kLanes;

namespace {

constexpr std::uint32_t kNoPlace = std::numeric_limits<std::uint32_t>::max();

}  // namespace

Cut::Cut(Of of)
    : of_(std::move(of)),
      tiles_(std::make_unique<std::atomic<std::uint8_t>[]>(of_.committed.size())),
      committed_(make_block(of_.committed.size() * of_.layout.doubles)),
      trial_(make_block(of_.touched.size() * of_.layout.doubles)) {}

bool Cut::has_trial(std::size_t tile) const {
  return std::ranges::binary_search(of_.touched, static_cast<std::uint32_t>(tile));
}

const double* Cut::in_place(std::size_t tile, bool of_trial) const {
  const unsigned buffer = of_trial ? 1U - of_.committed[tile] : of_.committed[tile];
  return of_.blocks[tile / of_.tiles_per_block] + ((tile % of_.tiles_per_block) * 2 + buffer) * of_.layout.doubles;
}

double* Cut::saved(std::size_t tile, bool of_trial) const {
  if (!of_trial) return committed_.get() + tile * of_.layout.doubles;
  const auto at = std::ranges::lower_bound(of_.touched, static_cast<std::uint32_t>(tile));
  return trial_.get() + static_cast<std::size_t>(at - of_.touched.begin()) * of_.layout.doubles;
}

// Returns true if the caller now has the tile, whose states are in place, and false if they were saved or read. Waits
// for the other thread while that one has it, which takes microseconds.
bool Cut::take(std::size_t tile) {
  for (;;) {
    std::uint8_t state = kInPlace;
    if (tiles_[tile].compare_exchange_strong(state, kTaken, std::memory_order_acquire)) return true;
    if (state != kTaken) return false;
    std::this_thread::yield();
  }
}

void Cut::save(std::size_t tile) {
  if (tiles_[tile].load(std::memory_order_acquire) >= kSaved || !take(tile)) return;
  for (const bool of_trial : {false, true})
    if (!of_trial || has_trial(tile)) std::copy_n(in_place(tile, of_trial), of_.layout.doubles, saved(tile, of_trial));
  tiles_[tile].store(kSaved, std::memory_order_release);
}

void Cut::save_all() {
  for (std::size_t tile = 0; tile < of_.committed.size() && !over(); ++tile) save(tile);
}

States Cut::blank(std::vector<std::uint32_t> rows) const {
  std::vector<std::uint32_t> slots;
  for (const std::uint32_t row : rows) slots.push_back(of_.nodes->slot_of(row));
  return blank_states(of_.layout.states(), of_.pairs, of_.map, std::move(rows), slots);
}

Cut::Contents Cut::read() {
  const struct AtEnd {
    std::atomic<bool>& over;
    ~AtEnd() { over.store(true, std::memory_order_release); }
  } at_end{over_};
  const NodeTable& nodes = *of_.nodes;
  std::vector<std::uint32_t> row_of_slot(of_.committed.size() * kLanes, kNoPlace);
  std::vector<std::uint32_t> rows(nodes.size());
  std::iota(rows.begin(), rows.end(), 0U);
  std::vector<std::uint32_t> trial_rows;
  std::vector<std::uint32_t> place_in_trial(of_.has_trial ? nodes.size() : 0, kNoPlace);
  for (std::uint32_t row = 0; row < nodes.size(); ++row) {
    row_of_slot[nodes.slot_of(row)] = row;
    if (!of_.has_trial || !has_trial(nodes.slot_of(row) / kLanes)) continue;
    place_in_trial[row] = static_cast<std::uint32_t>(trial_rows.size());
    trial_rows.push_back(row);
  }
  Contents contents{.node_ids = nodes.ids(), .committed = blank(std::move(rows)), .trial = std::nullopt};
  if (of_.has_trial) contents.trial = blank(std::move(trial_rows));
  for (std::size_t tile = 0; tile < of_.committed.size(); ++tile) {
    const bool taken = take(tile);
    const bool trial = has_trial(tile);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const std::uint32_t row = row_of_slot[tile * kLanes + lane];
      if (row == kNoPlace) continue;
      const auto states = of_.layout.states();
      put_state((taken ? in_place(tile, false) : saved(tile, false)) + lane, states, row, contents.committed);
      if (trial)
        put_state((taken ? in_place(tile, true) : saved(tile, true)) + lane, states, place_in_trial[row],
                  *contents.trial);
    }
    tiles_[tile].store(kRead, std::memory_order_release);
  }
  committed_.reset();  // here, where the time that it takes holds nobody up
  trial_.reset();
  return contents;
}

}  // namespace shearbus::shard
