// The check of closure: a force-driven host that applies the answered stress must arrive at the velocity jump that the
// server answered. For this check a node keeps states that describe its exchange with the host, not its layer: the jump
// that the last committed step answered, and the times of layer and host. A shard without the check has no such states.
#pragma once

#include <cstddef>
#include <cstdint>

#include "server/physics/solver/model.hpp"
#include "server/physics/solver/states.hpp"
#include "server/physics/solver/tile.hpp"
#include "server/shard/states.hpp"

namespace shearbus::shard {

// Layout of a tile: the states of the model, the sums of the friction energy where the scene has them, then the states
// of the exchange with the host (infinite: value not known).
class TileStates : public physics::TileLayout {
  bool sums_energy_;
  std::size_t components_;  // number of tangential components of the answered jump; 0: the shard does not check closure

 public:
  TileStates(const physics::Model& model, bool check_closure, bool sum_energy = false)
      : TileLayout(model.layout()),
        sums_energy_(sum_energy),
        components_(check_closure && model.options().strategy == physics::Strategy::kForceDriven
                        ? static_cast<std::size_t>(model.options().tangential_components)
                        : 0) {}

  // Friction heat that the soft body and the hard one have got since the node began: two values.
  static constexpr const char* kFrictionEnergy = "friction_energy_j_per_m2";
  std::size_t friction_energy = add(kFrictionEnergy, "J m-2", sums_energy_ ? 2 : 0);

  static constexpr const char* kAnsweredJump = "answered_jump_m_per_s";
  std::size_t answered_jump = add(kAnsweredJump, "m s-1", components_);
  // sum of the lengths of all steps that the node took
  std::size_t layer_time = add("layer_time_s", "s", components_ > 0);
  // host's time at the end of the last step; infinite if the host gave no time, or the node no row or got no answer
  std::size_t host_time = add("host_time_s", "s", components_ > 0);

  bool check_closure() const { return components_ > 0; }
  bool sums_energy() const { return sums_energy_; }

  // Writes the initial states of the exchange with the host for all nodes of a tile.
  void begin_exchange(double* tile) const;
};

// Whether the states hold answered jumps, hence come from a shard that checks closure; and whether they hold sums of the
// friction energy.
bool checks_closure(const States& states);
bool sums_energy(const States& states);

// How the jumps and the time that the host sends with a step differ from those that the server expects after the last
// step. A row is the entry of one node in the host's request.
struct Closure {
  double largest = -1.0;    // largest |jump of the host - answered jump|; negative: no node had an answered jump  [m/s]
  std::uint32_t row = 0;    // row of the largest difference of jumps (the first one, if several are equal)
  std::uint64_t timed = 0;  // number of nodes for which the host gave its time with this step and with the last one
  std::uint64_t agree = 0;  // number of nodes in `timed` for which the host's time grew by the length of the step
  // growth of the host's time between the two steps, in the first row where it is not the length of the step  [s]
  double host_time_step = 0.0;
  std::uint32_t time_row = 0xffffffff;  // the row of host_time_step; 0xffffffff: none

  Closure& operator+=(const Closure& other);
};

// Length of a step, and the host's time at the end of the step, 0 if the host gives none  [s].
struct HostStep {
  double dt;
  double time;
};

// Writes the states of the exchange with the host for the nodes of one tile, after a step from the states `from` to the
// states `to`. `named`: bits of the lanes (nodes) that have a row in the request; `lane_rows`: their rows. `open`: bits
// of the lanes without a row that are stepped as open contacts. These, and lanes whose step failed, have no answered
// jump afterwards. All other lanes keep their states. `difference`: for each component [kLanes], the jump that the host
// sent minus the jump that the server answered before, NaN where it answered none.
Closure exchange(const TileStates& states, const HostStep& step, const physics::TileInputs& in,
                 const physics::TileOutputs& out, std::uint32_t named, std::uint32_t open,
                 const std::uint32_t* lane_rows, const double* from, double* to,
                 double (&difference)[2][physics::kLanes]);

}  // namespace shearbus::shard
