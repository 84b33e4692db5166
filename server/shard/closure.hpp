// States of a node that describe its exchange with the host, not its layer: the jump that the last committed step
// answered, and the times of layer and host. They follow the states of the model in a tile. Only a shard that checks
// closure has them; a force-driven host that applies the answered stress brings the answered jump with its next step.
#pragma once

#include <cstddef>
#include <cstdint>

#include "server/physics/solver/model.hpp"
#include "server/physics/solver/states.hpp"
#include "server/physics/solver/tile.hpp"
#include "server/shard/states.hpp"

namespace shearbus::shard {

// The states of the model and behind them those of the exchange. An unknown jump or time is infinite.
class TileStates : public physics::TileLayout {
  std::size_t components_;  // tangential components of the answered jump; 0: closure is not checked

 public:
  TileStates(const physics::Model& model, bool check_closure)
      : TileLayout(model.layout()),
        components_(check_closure && model.options().strategy == physics::Strategy::kForceDriven
                        ? static_cast<std::size_t>(model.options().tangential_components)
                        : 0) {}

  static constexpr const char* kAnsweredJump = "answered_jump_m_per_s";
  std::size_t answered_jump = add(kAnsweredJump, "m s-1", components_);
  std::size_t layer_time = add("layer_time_s", "s", components_ > 0);  // sum of the lengths of its steps
  std::size_t host_time = add("host_time_s", "s", components_ > 0);    // time_s of the last step that named the node

  bool check_closure() const { return components_ > 0; }

  // The initial states of the exchange, all lanes.
  void begin_exchange(double* tile) const;
};

// Whether states are of a shard that checks closure.
bool checks_closure(const States& states);

// The exchange of one step: what the host brought, compared with what its nodes were answered before.
struct Closure {
  double largest = -1.0;                // largest difference of the jumps; below 0: no node had an answered jump  [m/s]
  std::uint32_t row = 0;                // its row; of equal differences the first one
  std::uint64_t timed = 0;              // number of rows whose last step had a time
  std::uint64_t agree = 0;              // number of those rows whose time grew by the length of the step
  double host_time_step = 0.0;          // growth of the host's time in one of the other rows, the first one  [s]
  std::uint32_t time_row = 0xffffffff;  // that row

  Closure& operator+=(const Closure& other);
};

// The length of the step and the host's time at its end, 0: not given  [s].
struct HostStep {
  double dt;
  double time;
};

// Writes the states of the exchange of one tile after a step. `lane_rows`: row of each lane in `named`; `open`: lanes
// that the step opened without a row. Lanes without an answer and open lanes have no answered jump after the step; all
// other lanes keep their states. `difference`: for each component [kLanes], the jump of the host less the jump answered
// before, NaN where none was answered.
Closure exchange(const TileStates& states, const HostStep& step, const physics::TileInputs& in,
                 const physics::TileOutputs& out, std::uint32_t named, std::uint32_t open,
                 const std::uint32_t* lane_rows, const double* from, double* to,
                 double (&difference)[2][physics::kLanes]);

}  // namespace shearbus::shard
