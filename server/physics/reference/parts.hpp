// Functions of which the steps of the reference solver (advance_one.hpp) are composed.
#pragma once

#include <functional>
#include <vector>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/reference/advance_one.hpp"

namespace shearbus::physics::reference {

inline constexpr int kScan = 4000;  // number of points at which a search for all roots looks for changes of sign

// Finds the only zero of f in [lo, hi], where f rises from negative values. Bisects until no number lies between the
// ends.
double bisect(const std::function<double(double)>& f, double lo, double hi);

// A value for each vertex of the heat grid (with heat in modes: for each row of HeatModes). operator[](i) gives the
// value at vertex i of the soft body; vertex 0 is at z = 0.
struct Profile {
  std::vector<double> rows;
  std::size_t interface = 0;
  // Temperatures of the rows between which k(T) and c(T) are taken; empty: constant
  std::vector<double> coefficients_from, coefficients_to;
  double operator[](std::size_t vertex) const { return rows[interface + vertex]; }
};

Profile profile_of(const NodeState& state);
HeatGrid heat_grid_of(const ModelOptions& options);

// Share of the friction heat that enters the heat equation: beta_T if only the soft body is on the grid, 1 if both
// bodies are.
double conducted_share(const ModelOptions& options);

// Backward Euler of dT/dt = alpha d2T/dz2 in each body with sources [W/m2] at the vertices from z = 0 into the soft
// body and insulated far ends: DLP (20-31).
Profile conduct(const ModelOptions& options, double dt, const std::vector<double>& sources, const Profile& old);

// The response of the temperatures to 1 W/m2 at z = 0, or distributed over the layer by `shape`.
Profile unit_response(const ModelOptions& options, double dt, const std::vector<double>& shape, const Profile& like);

// A step with the friction heat flux q ends at the temperatures T_ad + q B, where T_ad are those without friction.
struct Heat {
  Profile T_ad, B;
};
Heat heat_of_step(const ModelOptions& options, double dt, const NodeState& state, const Profile& old);
inline constexpr double kGamma = 0.29289321881345254;  // coefficient gamma of SDIRK2, 1 - 1/sqrt(2)
// T_ad and B of the second stage of SDIRK2. `old`: temperatures before the step; `early`, `early_flux`: state and heat
// flux of the first stage.
Heat heat_of_second_stage(const ModelOptions& options, double dt, double early_flux, const Profile& old,
                          const NodeState& early);
// Whether a second-order step may end at the temperatures T: none is below the coldest old temperature, and all are
// below melting. With heat in modes: whether T0 is below melting.
bool in_range(const ModelOptions& options, double pressure, const Profile& old, const Profile& T);

// Sets the temperatures of the state to T_ad, those without friction, plus the rise flux * B by the friction heat.
void heat_up(NodeState& state, const Profile& T_ad, double flux, const Profile& B);

// The plastic strain increment dep of one vertex under a stress magnitude [Pa], by the flow law as its paper prints it.
double strain_increment(const Material& m, double a, double pressure, double T, double ep_old, double dt);

// Friction at z = 0 at the end of a step of length dt with this slip velocity, by the law of the options, as its paper
// prints it; infinity: none limits the stress  [Pa]. `state`: of the law before the step.
double friction_of(const ModelOptions& options, double pressure, double T0, double slip, double dt, double state);
// The shear strength of the interface or its junctions, which have the strain `junction_strain` before the step  [Pa].
double interface_yield(const ModelOptions& options, double pressure, double T0, double slip, double dt,
                       double junction_strain);
// Slip velocity due to the plastic shear of the host's soft zone, sqrt(3) h Ep_dot, signed, DLP (64)  [m/s].
double host_shear(const ModelOptions& options, const NodeInputs& in);
// The least slip velocity for which a force-driven step asks a friction law with a state. `jump_old`: before the step,
// along the slip. `jump_free`: after it without friction. Both with the host's plastic shear.
double least_slip_of_law(double jump_old, double jump_free);
// The state of the law after the step.
double friction_state_after(const ModelOptions& options, double pressure, double slip, double dt, double state);

// The second-order step of an open contact, which nothing heats, from the temperatures `old`: only conducts. Returns
// false, with the state unchanged, where a melt or the range of the temperatures forbids it.
bool conducted_sdirk2(const ModelOptions& options, double dt, const NodeInputs& in, const Profile& old,
                      NodeState& state, NodeOutputs& out);

// One step of backward Euler of either strategy, with any flow law and contact law, without inertia and melt film.
// `heat`: of the step, or of a stage of SDIRK2.
NodeOutputs one_step(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state, const Heat& heat);

// The force-driven step of an interface that may melt (MODEL.md, "Melt film").
NodeOutputs melting_force_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state);

// The step of a layer with inertia of either strategy, by backward Euler or by SDIRK2.
NodeOutputs with_inertia(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state, bool sdirk2);

// advance_uncontrolled(): one undivided step by the integrator of the options. advance_controlled(): a step divided
// into substeps, so that its estimated error is below the tolerance of the options.
NodeOutputs advance_uncontrolled(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state);
NodeOutputs advance_controlled(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state);

}  // namespace shearbus::physics::reference
