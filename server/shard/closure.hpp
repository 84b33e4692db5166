// States of a node that describe its exchange with the host, not its layer: the jump that the last committed step
// answered, and the times of layer and host. They follow the states of the model in a tile. Only a shard that checks
// closure has them: a force-driven host that applies the answered stress sends the answered jump with its next step.
#pragma once

#include <cstddef>
#include <cstdint>

#include "server/physics/solver/model.hpp"
#include "server/physics/solver/states.hpp"
#include "server/physics/solver/tile.hpp"
#include "server/shard/states.hpp"

namespace shearbus::shard {

// The states of the model, followed by the states of the exchange. An unknown jump or time of the host is infinite.
class TileStates : public physics::TileLayout {
  std::size_t components_;  // number of tangential components of the answered jump; 0: closure is not checked

 public:
  TileStates(const physics::Model& model, bool check_closure)
      : TileLayout(model.layout()),
        components_(check_closure && model.options().strategy == physics::Strategy::kForceDriven
                        ? static_cast<std::size_t>(model.options().tangential_components)
                        : 0) {}

  static constexpr const char* kAnsweredJump = "answered_jump_m_per_s";
  std::size_t answered_jump = add(kAnsweredJump, "m s-1", components_);
  // sum of the lengths of all steps that the node took
  std::size_t layer_time = add("layer_time_s", "s", components_ > 0);
  // time_s of the last step; infinite if time_s was 0, or if the node had no row or no answer in that step
  std::size_t host_time = add("host_time_s", "s", components_ > 0);

  bool check_closure() const { return components_ > 0; }

  // Writes the initial states of the exchange into all lanes of a tile.
  void begin_exchange(double* tile) const;
};

// True if the states come from a shard that checks closure.
bool checks_closure(const States& states);

// The differences between the jumps and the time that the host sends with a step and those kept from the step before.
struct Closure {
  double largest = -1.0;    // largest |jump of the host - answered jump|; negative: no node had an answered jump  [m/s]
  std::uint32_t row = 0;    // row of the largest difference; of equal differences the first one
  std::uint64_t timed = 0;  // number of rows for which the host gave a time for this step and the one before
  std::uint64_t agree = 0;  // number of those rows in which the host's time grew by the length of the step
  double host_time_step = 0.0;          // growth of the host's time in the first row where it is not that length  [s]
  std::uint32_t time_row = 0xffffffff;  // row that host_time_step is taken from

  Closure& operator+=(const Closure& other);
};

// A step: its length, and the host's time at its end, 0 if not given  [s].
struct HostStep {
  double dt;
  double time;
};

// Writes the states of the exchange of one tile after a step; `from` and `to` are the states of the tile before and
// after it. `named`: bits of the lanes that have a row, `lane_rows`: their rows; `open`: bits of the lanes that are
// stepped as open contacts without a row. Open lanes and lanes without an answer have no answered jump after the step.
// Lanes that are neither named nor open keep their states. `difference`: for each component [kLanes], the jump of the
// host minus the jump answered before, NaN where no jump was answered.
Closure exchange(const TileStates& states, const HostStep& step, const physics::TileInputs& in,
                 const physics::TileOutputs& out, std::uint32_t named, std::uint32_t open,
                 const std::uint32_t* lane_rows, const double* from, double* to,
                 double (&difference)[2][physics::kLanes]);

}  // namespace shearbus::shard
