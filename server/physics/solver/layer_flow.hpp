// Plastic flow of the layers of a tile under given stresses (MODEL.md section 4): DLP (42-48).
#pragma once

#include "server/physics/layer/grid.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

// A stress magnitude per lane and what the flow needs of it.
struct FlowLoad {
  alignas(64) double log_load[kLanes];  // log(sqrt(3) a / Y0)
  alignas(64) double flux[kLanes];      // q: T = T_ad + q B          [W/m2]
  alignas(64) double bracket[kLanes];   // 1 + gP P + 300 hT, so that bracket - hT T is the bracket of g
};

struct FlowSum {
  alignas(64) double slip[kLanes];   // integral of dep over the layer                  [m]
  alignas(64) double slope[kLanes];  // a d slip / d a, heating by a included           [m]
};

// log(1 + beta ep) of each vertex: the layer yields where the load exceeds it. [vertex][lane].
void yield_thresholds(const Material& soft, int num_vertices, const double* strain, double* threshold);

// The integral and its slope at one load. `T_ad`, `strain` (old) and `threshold` are [vertex][lane].
void flow_under(const Material& soft, const Grid& grid, const double* response, const FlowLoad& load,
                const double* T_ad, const double* strain, const double* threshold, FlowSum& sum);

// The same sums, writing the new strain over the thresholds.
void flow_to(const Material& soft, const Grid& grid, const double* response, const FlowLoad& load, const double* T_ad,
             const double* strain, double* threshold_to_strain, FlowSum& sum);

}  // namespace shearbus::physics
