// Heat across the layer (MODEL.md section 3): backward Euler in time, finite volumes around the vertices, DLP (20-35).
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "server/physics/layer/grid.hpp"
#include "server/physics/layer/lanes.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

// The vertices heat lives on: those of the layer and, for a half-space, of the soft body behind it. The extension
// begins with the layer's last cell and widens by kExtensionGrading up to kExtensionDepth thicknesses, where it is
// insulated. Its vertices hold the geometric mean of their two cells: on geometric cells that makes the response of the
// discrete half-space that of the real one (arithmetic means leave it (ln grading)^2/16 too stiff, at all times), so
// few wide cells will do. A matched grid goes on as it is graded, and its cells are as much longer to heat as makes up
// for its arithmetic means. Where the hard body conducts too, its vertices come first, the outermost leading: one line
// of cells through z = 0.
struct HeatGrid {
  static constexpr double kExtensionGrading = 1.3;
  static constexpr double kExtensionDepth = 1000.0;
  static constexpr double kLeastMatchedGrading = 1.001;  // of a matched grid's extension

  HeatGrid(const Grid& soft, FarBoundary far_boundary);
  HeatGrid(const Grid& soft, FarBoundary far_boundary, const Grid& hard, FarBoundary hard_far_boundary);

  int num_vertices() const { return static_cast<int>(weight.size()); }

  // Heat that a degree at a vertex holds  [J/(m2 K)].
  double capacity(int vertex, const Material& soft, const Material& hard) const;

  int interface = 0;           // the vertex at z = 0
  std::vector<double> width;   // of each cell, as heat sees it                  [m]
  std::vector<double> weight;  // of each vertex: the length whose heat it holds; at z = 0 that in the soft body [m]
  double hard_weight = 0.0;    // length in the hard body whose heat the vertex at z = 0 holds  [m]
};

// One backward Euler step of length dt without sources, factorised, and the response to a unit flux at z = 0.
//   (1 + a[i] + c[i]) t[i] = old[i] + a[i] t[i-1] + c[i] t[i+1],   a = alpha dt / (weight * width before), c after
// Eliminated from both far ends towards z = 0, solved for from z = 0 outwards: where nothing is above the far
// temperature yet there is nothing to eliminate, and what arrives there only dies away. Every coefficient is positive
// and no difference is taken, so neither is anything cancelled: accurate to rounding for any dt and grading.
struct HeatOperator {
  HeatOperator(const HeatGrid& grid, const Material& soft, const Material& hard, double step);
  HeatOperator(const HeatGrid& one_sided, const Material& soft, double step)
      : HeatOperator(one_sided, soft, soft, step) {}
  // Its memory alone, for factorise() to fill.
  HeatOperator(const HeatGrid& grid, double step);
  void factorise(const HeatGrid& grid, const Material& soft, const Material& hard);

  double dt;                        // [s]
  int interface;                    // the vertex at z = 0
  std::span<double> inverse_pivot;  // 1 / pivot[i]
  std::span<double> inward;    // what the elimination carries on to vertex i from its outer neighbour, over pivot[i]
  std::span<double> outward;   // t[i] / t[i's inner neighbour] where nothing was; at z = 0 none
  double inward_hard;          // as `inward`: to z = 0 from the hard body; there `inward` is from the soft one
  std::span<double> response;  // B: temperature after a step with q = 1 W/m2 from 0 K   [K m2/W]

  const double* layer_response() const { return response.data() + interface; }  // from z = 0 into the soft body

 private:
  std::unique_ptr<double[]> memory_;  // one block: a step length costs few allocations
};

// What heat released across the layer needs beside HeatOperator: its sources at the layer's vertices.
struct SpreadHeat {
  SpreadHeat(const HeatGrid& grid, double dt, int layer_vertices, const Material& soft, const Material& hard);

  std::vector<double> gain;  // dt / capacity of each vertex of the layer: rise per source  [K m2/W]
};

// Temperature after a step from 0 K with 1 W/m2 shared over the layer as `shape` says, [vertex][lane] of the layer.
void respond(const HeatOperator& heat, const SpreadHeat& spread, const double* shape, double* response);

// T = T_ad + q B_phi over both bodies, all lanes; `response` as respond() left it.
void add_spread(const HeatOperator& heat, const SpreadHeat& spread, const double (&flux)[kLanes],
                const double* response, double* temperature);

// All lanes of a tile, without flux: from `before` to `after`, both [vertex][lane]. They may be the same. Vertices that
// have the far temperature, and to which nothing comes in this step that would change a bit, are not solved.
void conduct(const HeatOperator& heat, int num_vertices, const double* before, double* after);

// The same for one lane of a tile, in place.
void conduct_lane(const HeatOperator& heat, int num_vertices, int lane, double* temperature);

// T = T_ad + q B, DLP (35), all lanes or one. Vertices where q B is below half an ulp of the coldest temperature are
// not touched: it would not change a bit of theirs.
void add_flux(const HeatOperator& heat, int num_vertices, const double (&flux)[kLanes], double* temperature);
void add_flux_lane(const HeatOperator& heat, int num_vertices, int lane, double flux, double* temperature);

}  // namespace shearbus::physics
