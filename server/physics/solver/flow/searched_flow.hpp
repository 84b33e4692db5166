// Plastic flow of the layers of a tile for flow laws whose strain increment must be searched for at each vertex, because
// it hardens by its rate (METHODS.md, "Velocity-driven root"). The searches of a vertex start from the root of its last
// sum, moved along its slope, or from those of its neighbours towards z = 0.
#pragma once

#include <cstddef>

#include "server/physics/material/material.hpp"
#include "server/physics/solver/flow/layer_flow.hpp"

namespace shearbus::physics {

// The flow of each lane under its load.
struct SearchedFlow {
  static constexpr int kTerms = 4;       // numbers kept of each vertex: root, dep, d(dep)/d(ln a), strength at rest
  alignas(64) double slip[kLanes];       // integral of the strain increment dep over the layer  [m]
  alignas(64) double slope[kLanes];      // derivative of `slip` by ln(a) at the same flux per stress  [m]
  alignas(64) double last_load[kLanes];  // FlowLoad::load of the last sum
  alignas(64) double last_flux[kLanes];  // heat flux of the last sum  [W/m2]
  alignas(64) double stress[kLanes], log_slip[kLanes];  // stress [Pa] and logarithm of the slip of nearby_flow()
  bool summed;                                          // false: no sum has been made since start_search()
  double* rows;                                         // what is kept of the vertices, [vertex][term][lane]
};

// Prepares the sums of a step; `flow` keeps the array `rows`, of the size searched_rows(grid).
std::size_t searched_rows(const Grid& grid);
void start_search(double* rows, SearchedFlow& flow);

// Sums the flow of all lanes under their loads, and writes the new plastic strain of all vertices. The answer of a lane
// depends on the loads of that lane since start_search() alone.
void sum_flow(const FlowProblem& problem, const FlowLoad& load, double* strain_new, SearchedFlow& flow);

FlowAccuracy accuracy_of(const SearchedFlow& flow, int lane);
// What the last two sums tell of the flow of a lane under stresses near `a`, that of the last one: a power of the stress.
NearbyFlow nearby_flow(SearchedFlow& flow, double a, int lane);

}  // namespace shearbus::physics
