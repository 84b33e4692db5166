// Plastic flow of the layers of a tile under given stresses (MODEL.md, "Plastic strain"): DLP (42-48).
#pragma once

#include "server/physics/layer/grid.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

// Whatever the law of the flow stress, the layer yields at a vertex where its excess is positive
// (material/flow_law.hpp). Vertices beyond `num_heated` do not feel the heat of the step in any digit: there everything
// but the load is known in advance.

// A stress magnitude a per lane and what the flow needs of it.
struct FlowLoad {
  alignas(64) double load[kLanes];     // the law's load_of(a), or kNoLoad
  alignas(64) double flux[kLanes];     // q: T = T_ad + q B, or B_phi                        [W/m2]
  alignas(64) double bracket[kLanes];  // the law's, at the lane's pressure
  alignas(64) double T_melt[kLanes];   // at the lane's pressure                             [K]
};

struct FlowSum {
  alignas(64) double slip[kLanes];   // integral of dep over the layer                  [m]
  alignas(64) double slope[kLanes];  // a d slip / d a, heating by a included           [m]
  int num_yielding;                  // vertices from the interface to the last one at which any lane yields
};

// The layers of a tile at the start of a step. Arrays are [vertex][lane].
struct FlowProblem {
  const Material* soft;
  const Grid* grid;
  const double* response;  // B
  const double* T_ad;
  const double* strain;  // old
  int num_heated;
  double dt;
  const double* spread_response = nullptr;  // B_phi, [vertex][lane]: instead of B where heat is released in the layer
};

// Number of vertices, from the interface, that the heat of one step can reach: the others' share is below rounding.
int num_heated_vertices(const Grid& grid, const double* response);

// Loads a lane with the stress magnitude a and the heat flux q; `soft` is the material at the pressure P.
void set_load(const Material& soft, double pressure, double a, double flux, int lane, FlowLoad& load);

// What yields have in common for all loads of the step.
void flow_thresholds(const FlowProblem& problem, const FlowLoad& load, double* threshold);

// The integral and its slope under one load. Only the first `num_rows` vertices are looked at: the caller knows that
// the others do not yield.
void flow_under(const FlowProblem& problem, const FlowLoad& load, int num_rows, const double* threshold, FlowSum& sum);

// The integral of one lane, without thresholds made beforehand; writes the new strain where `strain_new`, which may be
// the problem's own, is not null.
double flow_of_lane(const FlowProblem& problem, const FlowLoad& load, int lane, double* strain_new);

// The same sums, writing the new strain over the thresholds.
void flow_to(const FlowProblem& problem, const FlowLoad& load, int num_rows, double* threshold_to_strain, FlowSum& sum);

}  // namespace shearbus::physics
