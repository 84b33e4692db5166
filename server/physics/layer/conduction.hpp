// Heat across the layer (METHODS.md, "Conduction"): backward Euler in time, finite volumes around the vertices, DLP
// (20-35).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "server/physics/layer/grid.hpp"
#include "server/physics/layer/lanes.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

// The vertices of the temperature: those of the layer and, for a half-space, vertices of the soft body behind the
// layer. From the last cell of the layer on, each cell of this extension is wider than the cell before it by the ratio
// extension_grading(); the extension ends, insulated, at a depth of kExtensionDepth thicknesses. Arithmetic means would
// make geometric cells stiffer than the body by the fraction (ln grading)^2/16 of T0. Graded cells therefore have longer
// conduction lengths (conduction_stretch). Behind uniform cells, each vertex of the extension holds the heat of the
// geometric mean of its two cells instead: the discrete half-space responds as the continuous one does either way, so a
// few wide cells suffice. Where the hard body conducts, its vertices come first, the outermost vertex leading, so that
// both bodies form one row of cells through z = 0.
struct HeatGrid {
  static constexpr double kUniformExtensionGrading = 1.3;  // grading of the extension behind uniform cells
  static constexpr double kExtensionDepth = 1000.0;

  HeatGrid(const Grid& soft, FarBoundary far_boundary);
  HeatGrid(const Grid& soft, FarBoundary far_boundary, const Grid& hard, FarBoundary hard_far_boundary);

  int num_vertices() const { return static_cast<int>(weight.size()); }

  // Heat capacity per area of a vertex  [J/(m2 K)].
  double capacity(int vertex, const Material& soft, const Material& hard) const;

  int interface = 0;              // index of the vertex at z = 0
  std::vector<double> width;      // conduction length of each cell                 [m]
  std::vector<double> weight;     // length whose heat each vertex holds; at z = 0 the part in the soft body [m]
  bool soft_end_is_held = false;  // the last vertex of the soft body keeps its temperature
  bool hard_end_is_held = false;  // the outermost vertex of the hard body keeps its temperature
  double hard_weight = 0.0;       // length in the hard body whose heat the vertex at z = 0 holds  [m]
};

// Ratio of the conduction length of a cell to its width: 1 on a uniform grid.
double conduction_stretch(double grading);

// Ratio of the widths of neighbouring cells that a half-space adds behind a grid. Behind graded cells it is theirs,
// since a change of the ratio reflects heat, but not so small that the extension would need many cells.
double extension_grading(const Grid& grid);

// One backward Euler step of length dt without sources, factorised, and the response to a unit flux at z = 0.
//   (1 + a[i] + c[i]) t[i] = old[i] + a[i] t[i-1] + c[i] t[i+1],   old and t: temperature before and after, and with
//   a[i] = alpha dt / (weight[i] * width of the cell before i), c[i] likewise with the cell behind i
// The elimination runs from both far ends to z = 0, the substitution from z = 0 outwards: vertices still at the far
// temperature need no elimination, and heat that reaches them decays outwards. All coefficients are positive and the
// factorisation forms no difference, so nothing cancels: the solution is accurate to rounding for any dt and grading.
struct HeatOperator {
  HeatOperator(const HeatGrid& grid, const Material& soft, const Material& hard, double step);
  HeatOperator(const HeatGrid& one_sided, const Material& soft, double step)
      : HeatOperator(one_sided, soft, soft, step) {}
  // This constructor only allocates the coefficients; factorise() computes them.
  HeatOperator(const HeatGrid& grid, double step);
  void factorise(const HeatGrid& grid, const Material& soft, const Material& hard);

  double dt;                        // step length  [s]
  int interface;                    // index of the vertex at z = 0
  std::span<double> inverse_pivot;  // 1 / pivot[i], where pivot is the diagonal after the elimination
  std::span<double> inward;   // coefficient of t[outer neighbour] in the equation of vertex i, divided by pivot[i]
  std::span<double> outward;  // ratio t[i] / t[inner neighbour] if the old temperatures are 0; unused at z = 0
  // The same coefficient as `inward` for z = 0 and its neighbour in the hard body; inward[interface] is the soft one.
  double inward_hard;
  std::span<double> response;  // response B: temperature after a step with q = 1 W/m2 from 0 K   [K m2/W]

  const double* layer_response() const { return response.data() + interface; }  // B at the layer's vertices, from z = 0

 private:
  std::unique_ptr<double[]> memory_;  // one block, so that a new step length needs few allocations
};

// Heat sources at the vertices of the layer, for work that is released across the layer.
struct SpreadHeat {
  SpreadHeat(const HeatGrid& grid, double dt, int layer_vertices, const Material& soft, const Material& hard);

  // Temperature rise of each vertex of the layer in a step, per heat flux into it: dt / capacity  [K m2/W]
  std::vector<double> gain;
};

// Writes B_phi, the temperature after a step from 0 K with 1 W/m2 distributed over the layer by the fractions `shape`.
// Both arrays are [vertex][lane] of the layer.
void respond(const HeatOperator& heat, const SpreadHeat& spread, const double* shape, double* response);

// Adds the distributed heat, T = T_ad + q B_phi, in both bodies and all lanes. `response` is what respond() wrote.
void add_spread(const HeatOperator& heat, const SpreadHeat& spread, const double (&flux)[kLanes],
                const double* response, double* temperature);

// Both in one lane, for a step shorter than that of `spread`: `shape` is then the fractions times the ratio of the steps.
void respond_lane(const HeatOperator& heat, const SpreadHeat& spread, int lane, const double* shape, double* response);
void add_spread_lane(const HeatOperator& heat, const SpreadHeat& spread, int lane, double flux, const double* response,
                     double* temperature);

// Conducts for one step without flux, in all lanes, from `before` to `after`, both [vertex][lane], which may be the
// same array. Vertices as cold as the colder far end are skipped if the step does not change their bits. `next`:
// distance in doubles to the rows of the tile that is probably stepped next, which are asked for from memory; 0: none.
void conduct(const HeatOperator& heat, int num_vertices, const double* before, double* after, std::ptrdiff_t next = 0);

// Conducts for one step without flux, in one lane of a tile and in place.
void conduct_lane(const HeatOperator& heat, int num_vertices, int lane, double* temperature);

// Adds the friction heat, T = T_ad + q B, DLP (35), in all lanes or in one lane. Vertices where q B is below half an
// ulp of the coldest temperature are skipped: their bits would not change.
void add_flux(const HeatOperator& heat, int num_vertices, const double (&flux)[kLanes], double* temperature);
void add_flux_lane(const HeatOperator& heat, int num_vertices, int lane, double flux, double* temperature);

// The parts of these functions that nodes with heat modes (modes.hpp) need too, for rows [row][lane] of all lanes.
// conduct_rows() decays each row by its factor and adds the decayed rows to `sum`; add_to_rows() adds flux * gain[i] to
// row i.
void conduct_rows(std::span<const double> decay, const double* before, double* after, double* sum);
void add_to_rows(std::span<const double> gain, const double (&flux)[kLanes], double* rows);

// More of this kind: extrapolate_rows() writes before + factor (rows - before) to `rows`; range_of_rows() finds the
// lowest and highest value of each lane; lanes_below() returns the lanes of which each row + flux * gain is below
// `bound`.
void extrapolate_rows(int num_rows, double factor, const double* before, double* rows);
void range_of_rows(std::ptrdiff_t num_rows, const double* rows, double (&lowest)[kLanes], double (&highest)[kLanes]);
std::uint32_t lanes_below(std::span<const double> gain, const double (&flux)[kLanes], const double (&bound)[kLanes],
                          const double* rows);

}  // namespace shearbus::physics
