// The answer of one step or substep of one lane.
#pragma once

#include <cstdint>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/states.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

struct LaneStep {
  double stress;    // shear stress s, signed             [Pa]
  double slip;      // sliding velocity [v], signed       [m/s]
  double jump_new;  // velocity jump [V] after the step (at n+1/2), signed [m/s]
  double flux;      // heat flux q at z = 0               [W/m2]
  Regime regime;
  bool sticks;   // the interface does not slip at the end of the step
  bool unique;   // false: the step may have several answers; always true if the node sticks and its layer flows
  bool several;  // other answers satisfied the equations of the step too
};

struct LaneResult {
  LaneStep step{};
  double heat = 0.0;         // friction heat of the step                                                   [J/m2]
  double flux = 0.0;         // heat flux still to be added to the temperatures; 0 if substeps have added it  [W/m2]
  std::uint8_t outcome = 0;  // bits (kOutsideDomain, ..., tile.hpp)
};

// The regime of metal that yields at the temperature T. `soft`: the material at the pressure.
inline Regime yielding_regime(const Material& soft, double T) {
  return T >= kMeltingShare * soft.melting_temperature ? Regime::kMelting : Regime::kTresca;
}

// The regime of an interface that slips, at the interface temperature T0 and the slip velocity `slip`.
inline Regime slip_regime(const StressLimit& limit, double T0, double slip) {
  return limit.at(T0, slip).is_coulomb ? Regime::kCoulomb : yielding_regime(*limit.soft, T0);
}

// Writes the answer of a lane, except the states and outputs that follow from the temperatures.
inline void write_answer(const LaneResult& result, const TileLayout& layout, int lane, double* trial,
                         TileOutputs& outputs) {
  outputs.shear_stress[lane] = trial[layout.shear_stress + lane] = result.step.stress;
  outputs.sliding_velocity[lane] = result.step.slip;
  outputs.velocity_jump_new[lane] = result.step.jump_new;
  outputs.friction_heat[lane] = result.heat;
  outputs.regime[lane] = result.step.regime;
  outputs.outcome[lane] = result.outcome;
  trial[layout.regime + lane] = static_cast<double>(result.step.regime);
}

}  // namespace shearbus::physics
