// Plastic flow of the layers of a tile as a function of the stress, for flow laws whose strain increment is an explicit
// function of it (METHODS.md, "Velocity-driven root"). One sum over the layer gives the flow and the strain under a
// stress, and the flow under stresses nearby as a series. So about two sums solve a balance, and the last of them has
// written the strain.
#pragma once

#include <cstddef>

#include "server/physics/material/material.hpp"
#include "server/physics/solver/flow/layer_flow.hpp"

namespace shearbus::physics {

// Bounds of what lies farther out in the layer, for blocks of vertices. Where even the hottest of the vertices from a
// block on would not yield with the least strain of them, none does, and an expansion ends.
struct FlowBounds {
  static constexpr int kBlocks = 16;
  std::ptrdiff_t rows;                         // number of vertices of each block but the last
  alignas(64) double T_ad[kBlocks][kLanes];    // the highest temperature T_ad of the vertices from the block on  [K]
  alignas(64) double strain[kBlocks][kLanes];  // their least plastic strain
  alignas(64) double spread[kBlocks][kLanes];  // their largest response B_phi, if heat is released in the layer
};

// The load of each lane.
struct StressLoad {
  alignas(64) double stress[kLanes];        // magnitude of the stress a                  [Pa]
  alignas(64) double heating[kLanes];       // heat flux per stress, q / a                [m/s]
  alignas(64) double base[kLanes];          // stress about which the flow is expanded, set by sum_flow()  [Pa]
  alignas(64) double base_heating[kLanes];  // `heating` about which the flow is expanded, set by sum_flow()  [m/s]
  alignas(64) double bracket[kLanes];       // bracket_at() of the flow law
  alignas(64) double T_melt[kLanes];        // melting temperature at the lane's pressure  [K]
};

// The flow of each lane under its stress a = base (1 + u) and its flux, 1 + w times that at the base. Under another
// load it is, if the same vertices yield,
//   (1 + u)^exponent (moment[0] + moment[1] w + moment[2] w^2 + moment[3] w^3) + a constant
struct ExpandedFlow {
  static constexpr int kTerms = NearbyFlow::kTerms;
  alignas(64) double slip[kLanes];            // integral of the strain increment dep over the layer  [m]
  alignas(64) double slope[kLanes];           // derivative of `slip` by ln(a) at the same `heating`  [m]
  alignas(64) double moment[kTerms][kLanes];  // [m]
  alignas(64) double u[kLanes], y[kLanes];    // a / base - 1 and (1 + u)^exponent
  alignas(64) double w[kLanes];               // q / (flux at the base) - 1; u if `heating` is that of the base
  alignas(64) double steepest[kLanes];        // how fast the fastest of the vertices' expansions grows with w
  alignas(64) double origin[kLanes];          // stress about which `limit` is known  [Pa]
  alignas(64) double origin_flux[kLanes];     // heat flux about which `limit` is known  [W/m2]
  alignas(64) double limit[kLanes];           // number of vertices from z = 0 to the last block with one that can yield
  std::ptrdiff_t num_rows[kLanes];            // the largest limit of a register, at its first lane
  double exponent;                            // exponent of the flow law, 1 / n
  FlowBounds bounds;
  double* rows;  // expansions of the vertices, [vertex][term][lane]
};

// Whether the flow law has an explicit strain increment.
bool has_expanded_flow(const Material& soft);
// Whether the softening g of such a law is above 0; `soft` is the material at the pressure.
bool carries_stress(const Material& soft, double pressure, double T);
// Whether a search at the temperature T needs no bound of the stress from above: the softening g is not so small that
// the answer may be many powers of ten below any guess.
bool searches_unbounded(const Material& soft, double T);

// Loads a lane with the stress magnitude a; `soft` is the material at the pressure.
void set_load(const Material& soft, double pressure, double a, double heating, int lane, StressLoad& load);

// Prepares the sums of a step; `flow` keeps the array `rows`, of the size rows_of(grid).
std::size_t rows_of(const Grid& grid);
void start_flow(const FlowProblem& problem, double* rows, ExpandedFlow& flow);

// Sums the flow of all lanes under their stresses, and writes the new plastic strain of all vertices. The answer of a
// lane depends on the stresses of that lane since start_flow() alone.
void sum_flow(const FlowProblem& problem, StressLoad& load, double* strain_new, ExpandedFlow& flow);

FlowAccuracy accuracy_of(const ExpandedFlow& flow, int lane);
// What the last sum tells of the flow of a lane under loads nearby.
NearbyFlow nearby_flow(const ExpandedFlow& flow, const StressLoad& load, int lane);

// The stress of each lane at which the balance a + compliance slip = a_trial is met by the expansion with the flux per
// stress of the base; -1 where the expansion is not good enough to tell.
void roots_of(const ExpandedFlow& flow, const StressLoad& load, double compliance, const double (&a_trial)[kLanes],
              double (&root)[kLanes]);

}  // namespace shearbus::physics
