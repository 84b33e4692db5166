// The reference twin of the solvers: a scalar solver of the step of one node, slow and obvious, against which the fast
// solvers are tested. The twin shares the grids, the heat modes, beta_T and the functions of material/strength.hpp with
// the fast solvers. Strain increments and friction are written here as their papers print them. The heat equation is
// solved by Eigen's sparse LU, every scalar root by bisection.
#pragma once

#include <vector>

#include "server/physics/solver/model.hpp"

namespace shearbus::physics::reference {

struct NodeState {
  std::vector<double> temperature;  // temperature at the soft body's heat vertices, z = 0 first [K]
  // Temperatures in a conducting hard body, outermost vertex first  [K]. With heat in modes it holds instead the start
  // temperature and then the share of each mode in T0.
  std::vector<double> hard_temperature;
  std::vector<double> plastic_strain;  // plastic strain at each layer vertex
  std::vector<double> heat_shape;      // share of the work that heats each layer vertex; empty: all work heats z = 0
  std::vector<double> stress_field;    // with inertia: stress at each layer vertex                        [Pa]
  // With inertia: velocity of each layer cell, relative to the hard body, force-driven and of the host's mass behind them
  // [m/s].
  std::vector<double> layer_velocity;
  double shear_stress = 0.0;  // [Pa]
  Regime regime = Regime::kOpen;
  bool sticking = false;         // next to a layer that flows: the interface did not slip at the end of the last step
  double junction_strain = 0.0;  // plastic strain of the junctions, ep_a
  double friction_state = 0.0;   // of the friction law: psi [Pa], or ln(V0 theta/D)
  std::vector<double> liquid_fraction;  // with a melt film: at the soft body's heat vertices
  // Of the step at hand: the temperatures at its ends, between which k(T) and c(T) are taken, in the order of both bodies.
  std::vector<double> coefficients_from, coefficients_to;
};

struct NodeInputs {
  double velocity_jump = 0.0;
  double pressure = 0.0;
  double soft_shear_rate = 0.0;
  double stress_soft = 0.0;
  double stress_hard = 0.0;
  double mass_soft = 1.0;
  double mass_hard = 1.0;
  double soft_plastic_strain_rate = 0.0;  // signed
  bool backward_euler = false;  // backward Euler in spite of the options, because the fast solver fell back to it
};

struct NodeOutputs {
  double shear_stress = 0.0;
  double sliding_velocity = 0.0;
  double interface_temperature = 0.0;
  double velocity_jump_new = 0.0;
  double friction_heat = 0.0;
  double interface_slip = 0.0;  // slip velocity of the interface alone, without the flow of the layer  [m/s]
  double film_thickness = 0.0;  // [m]
  Regime regime = Regime::kOpen;
  double error_estimate = 0.0;  // with a tolerance: estimated error of T0, relative to T_melt less the initial T
  bool first_order = false;     // backward Euler solved a step meant for SDIRK2 (force-driven: unless it sticks)
  // Number of stresses that satisfy a force-driven step, found on a fine scan. With a plastic layer: 1 if the rules of
  // MODEL.md, "Plastic layer", determine the answer, otherwise the number of answers that may be meant.
  int answers = 1;
  bool sudden = false;  // force-driven, in one piece: the jump may be off by more than a tenth of the larger jump
};

NodeState initial_state(const ModelOptions& options);

// Advances `state` by dt. Where the step has several answers (`answers` above 1) the fast solver may divide it into
// substeps and return another answer. This function divides a step only to meet the tolerance of the options.
NodeOutputs advance_one(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state);

}  // namespace shearbus::physics::reference
