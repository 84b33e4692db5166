// Plastic flow of the layers of a tile under given stresses (MODEL.md, "Plastic strain"): DLP (42-48).
#pragma once

#include "server/physics/layer/grid.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

// A layer yields at each vertex at which the flow law computes a positive excess (material/flow_law.hpp). Only the
// first `num_heated` vertices feel the heat of a step.

// The load of each lane under a stress of magnitude a.
struct FlowLoad {
  alignas(64) double load[kLanes];  // stress a in the form of the flow law, load_of(a); kNoLoad: no stress
  alignas(64) double flux[kLanes];  // heat flux q; the temperatures are T_ad + q B, or T_ad + q B_phi     [W/m2]
  // Part of the softening g that depends on the pressure, bracket_at() of the flow law.
  alignas(64) double bracket[kLanes];
  alignas(64) double T_melt[kLanes];  // melting temperature at the lane's pressure         [K]
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

// How well a sum knows the flow of one lane.
struct FlowAccuracy {
  double hot;     // sum that the flow may be a small difference of  [m]
  double slope;   // derivative of the flow by ln(a) at the same flux per stress  [m]
  double digits;  // rounding error of the flow, relative to `slope`
};

// What sums over the layer tell of the flow of one lane under other loads: near the load of a sum, the flow is
//   (a / base)^exponent exp(curvature ln(a / base)^2) (moment[0] + moment[1] w + ... + moment[3] w^3) + constant
// where w is the relative change of the flux q from base_flux.
struct NearbyFlow {
  static constexpr int kTerms = 4;
  double base = 0.0;       // stress  [Pa]; 0: nothing is known of other loads
  double base_flux = 0.0;  // heat flux  [W/m2]
  double exponent = 0.0;
  double curvature = 0.0;
  double moment[kTerms] = {};  // [m]
  double constant = 0.0;       // [m]
  FlowAccuracy accuracy = {};

  struct Slip {
    double value, by_stress, by_flux;  // integral(dep)  [m], and its derivatives  [m/Pa], [m3/W]
  };
  Slip at(double stress, double flux) const;
};

// Whether a stress `a` under which the flow was summed meets its balance: the compliance times the plastic slip is
// `left`. The last digits of the flow count only if the flow is at most twice what it
// must be: far above the root, in a vertex that a few more digits would melt, any residual would pass.
bool is_balanced(double a, double left, double compliance, double slip, const FlowAccuracy& accuracy);

// Number of vertices, from z = 0, that the heat of one step reaches: it changes all other temperatures by less than
// rounding.
int num_heated_vertices(const Grid& grid, const double* response);

// Loads a lane with the stress magnitude a and the heat flux q; `soft` is the material at the pressure P.
void set_load(const Material& soft, double pressure, double a, double flux, int lane, FlowLoad& load);

// Returns the integral of the strain increment dep over the layer of one lane. Writes the new
// strain to `strain_new` unless that is null; `strain_new` may be the array of the old strain.
double flow_of_lane(const FlowProblem& problem, const FlowLoad& load, int lane, double* strain_new);

}  // namespace shearbus::physics
