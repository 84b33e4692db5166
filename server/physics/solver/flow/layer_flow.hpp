// Plastic flow of the layers of a tile under given stresses (MODEL.md, "Plastic strain"): DLP (42-48).
#pragma once

#include "server/physics/layer/grid.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

// A layer yields at each vertex at which the flow law computes a positive excess (material/flow_law.hpp). Only the
// first `num_heated` vertices feel the heat of a step. The temperature of the others is known before the step, so their
// yield condition is computed once and compared with each load.

// The load of each lane under a stress of magnitude a.
struct FlowLoad {
  alignas(64) double load[kLanes];  // stress a in the form of the flow law, load_of(a); kNoLoad: no stress
  alignas(64) double flux[kLanes];  // heat flux q; the temperatures are T_ad + q B, or T_ad + q B_phi     [W/m2]
  // Part of the softening g that depends on the pressure, bracket_at() of the flow law.
  alignas(64) double bracket[kLanes];
  alignas(64) double T_melt[kLanes];  // melting temperature at the lane's pressure         [K]
};

struct FlowSum {
  alignas(64) double slip[kLanes];  // integral of the strain increment dep over the layer   [m]
  // Derivative of `slip` by ln(a), where a is the stress; includes the heating by a  [m]
  alignas(64) double slope[kLanes];
  int num_yielding;  // number of vertices from z = 0 to the last one at which any lane yields
};

// The layers of a tile at the start of a step. Arrays are [vertex][lane].
struct FlowProblem {
  const Material* soft;
  const Grid* grid;
  const double* response;  // response B of the temperature to a unit heat flux at z = 0; one value per vertex  [K m2/W]
  const double* T_ad;      // temperature after the step without friction heat  [K]
  const double* strain;    // plastic strain before the step
  int num_heated;          // number of vertices, from z = 0, that the heat of the step reaches
  double dt;               // length of the step  [s]
  // Response B_phi to heat released in the layer; if not null, it replaces B.
  const double* spread_response = nullptr;
};

// Number of vertices, from z = 0, that the heat of one step reaches: it changes all other temperatures by less than
// rounding.
int num_heated_vertices(const Grid& grid, const double* response);

// Loads a lane with the stress magnitude a and the heat flux q; `soft` is the material at the pressure P.
void set_load(const Material& soft, double pressure, double a, double flux, int lane, FlowLoad& load);

// Writes the yield threshold of each vertex: the part of its yield condition that is the same for all loads of a step.
void flow_thresholds(const FlowProblem& problem, const FlowLoad& load, double* threshold);

// Computes the integral of the strain increment dep over the layer, and its derivative (FlowSum), under one load. Sums
// only the first `num_rows` vertices: the caller knows that the others do not yield.
void flow_under(const FlowProblem& problem, const FlowLoad& load, int num_rows, const double* threshold, FlowSum& sum);

// Returns the integral of the strain increment dep over the layer of one lane; needs no thresholds. Writes the new
// strain to `strain_new` unless that is null; `strain_new` may be the array of the old strain.
double flow_of_lane(const FlowProblem& problem, const FlowLoad& load, int lane, double* strain_new);

// Computes the same sums as flow_under(). Overwrites the array of thresholds with the new plastic strain of all
// vertices; the vertices from `num_rows` on keep their old strain.
void flow_to(const FlowProblem& problem, const FlowLoad& load, int num_rows, double* threshold_to_strain, FlowSum& sum);

}  // namespace shearbus::physics
