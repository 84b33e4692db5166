// The way of a jump that may stop and turn within a step (server/physics/MODEL.md, "Plastic layer", under a tolerance).
#pragma once

#include "server/physics/solver/force_driven/rigid_slip.hpp"

namespace shearbus::physics {

// The jump over a step under a stress of constant magnitude that opposes it: it slows down, may stop, and then rests
// unless the far stresses are larger.
class Travel {
 public:
  Travel() = default;  // of a step that is not asked for it
  Travel(const Forcing& forcing, const TrialSlip& trial, double dt);

  struct Path {
    double mean;       // mean speed  [m/s]
    double by_stress;  // its derivative by the stress, never above 0  [m/(s Pa)]
    double net;        // mean velocity along the trial direction  [m/s]
    double end;        // velocity after the step along the trial direction  [m/s]
    bool stops;        // what moved before the step stops within it
  };
  Path under(double stress) const;

  // The stress from which on nothing moves; infinity for a jump that is not 0 before the step  [Pa].
  double rest_stress() const;

  // The slip of the interface next to a layer that does not flow, under the largest stress that `limit` allows at this
  // slip. For a jump that stops or turns; stress and slip are those while it moves. `guess`: of the stress.
  LaneStep slip_next_to_rigid(const StressLimit& limit, double heat_partition, double B0, double T_ad,
                              double guess) const;

  // The answer of the step, from its stress and the mean slip speed while anything moves. The mean stress is what changes
  // the jump; the mean slip has its share of the net way.
  LaneStep answer(LaneStep moving) const;

 private:
  double direction_;   // trial direction, +1 or -1
  double before_;      // velocity before the step along the trial direction  [m/s]
  double push_;        // its change by the far stresses  [m/s]
  double per_stress_;  // its change per stress of the interface  [m/(s Pa)]
};

}  // namespace shearbus::physics
