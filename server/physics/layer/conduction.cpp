#include "server/physics/layer/conduction.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <iterator>

#define SHEARBUS_KERNELS "server/physics/layer/sweep.hpp"
#include "server/physics/layer/each_register.hpp"

namespace shearbus::physics {

// Each vertex of a graded grid holds the heat of one half of each of its two cells. T0 would therefore rise less under
// a flux than in the continuum, by the fraction (ln grading)^2/16. Longer conduction lengths compensate this.
double conduction_stretch(double grading) {
  return grading == 1.0 ? 1.0 : 0.5 * (1.0 + grading) / std::sqrt(grading);
}

double extension_grading(const Grid& grid) {
  if (grid.grading == 1.0) return HeatGrid::kUniformExtensionGrading;
  return std::max(grid.grading, grid.least_extension_grading);
}

namespace {

double eighth_power(double x) {
  const double fourth = (x * x) * (x * x);
  return fourth * fourth;
}

// With longer conduction lengths a slab with an insulated far face would respond too slowly by (stretch - 1) h^3/9 of
// the second moment of its capacity about that face, once heat fills it. Moves heat capacity from the far face inwards
// by this moment; the sum of the weights stays.
void correct_insulated_face(const Grid& grid, double stretch, std::vector<double>& weight) {
  if (grid.num_cells() < 2) return;
  const double h = grid.vertex.back();
  const auto near_face = [&](std::size_t i) {
    const double power = eighth_power(grid.vertex[i] / h);
    return power * power;
  };
  double sum = 0.0, next = 0.0, moment = 0.0;
  for (std::size_t i = 0; i < weight.size(); ++i) {
    sum += weight[i] * near_face(i);
    next += weight[i] * near_face(i) * (grid.vertex[i] / h);
  }
  const double balance = sum / next;  // of the two powers, so that no heat is gained
  const auto shift = [&](std::size_t i) { return near_face(i) * (1.0 - balance * (grid.vertex[i] / h)); };
  for (std::size_t i = 0; i < weight.size(); ++i) {
    const double depth = 1.0 - grid.vertex[i] / h;
    moment += weight[i] * shift(i) * (depth * depth);
  }
  const double size = (stretch - 1.0) / 9.0 * h / moment;
  for (std::size_t i = 0; i < weight.size(); ++i) weight[i] *= 1.0 + size * shift(i);
}

// With longer conduction lengths a steady flux to a far face that is held would meet too much resistance. Shortens the
// lengths next to that face, so that their sum is the thickness.
void correct_held_face(const Grid& grid, double stretch, std::vector<double>& width) {
  const double h = grid.vertex.back();
  const auto near_face = [&](std::size_t i) { return eighth_power(0.5 * (grid.vertex[i] + grid.vertex[i + 1]) / h); };
  double sum = 0.0;
  for (std::size_t i = 0; i < width.size(); ++i) sum += grid.width[i] * near_face(i);
  const double size = (stretch - 1.0) * h / sum;
  for (std::size_t i = 0; i < width.size(); ++i) width[i] -= size * grid.width[i] * near_face(i);
}

}  // namespace

HeatGrid::HeatGrid(const Grid& grid, FarBoundary far_boundary)
    : width(grid.width), soft_end_is_held(far_boundary == FarBoundary::kIsothermal) {
  const bool uniform = grid.grading == 1.0;
  const double ratio = extension_grading(grid);
  if (far_boundary == FarBoundary::kHalfSpace) {
    const double thickness = grid.vertex.back();
    double depth = thickness;
    while (depth < kExtensionDepth * thickness) {
      width.push_back(width.back() * ratio);
      depth += width.back();
    }
  }
  weight = grid.weight;
  if (width.size() > grid.width.size()) {
    weight.pop_back();
    for (std::size_t i = grid.width.size(); i < width.size(); ++i) {
      weight.push_back(uniform ? std::sqrt(width[i - 1] * width[i]) : 0.5 * (width[i - 1] + width[i]));
    }
    weight.push_back(0.5 * width.back());
  }
  if (uniform) return;
  const double stretch = conduction_stretch(grid.grading), behind = conduction_stretch(ratio);
  for (std::size_t i = 0; i < width.size(); ++i) width[i] *= i < grid.width.size() ? stretch : behind;
  if (far_boundary == FarBoundary::kInsulated) correct_insulated_face(grid, stretch, weight);
  if (far_boundary == FarBoundary::kIsothermal) correct_held_face(grid, stretch, width);
}

HeatGrid::HeatGrid(const Grid& soft, FarBoundary far_boundary, const Grid& hard, FarBoundary hard_far_boundary)
    : HeatGrid(soft, far_boundary) {
  const HeatGrid other(hard, hard_far_boundary);
  interface = other.num_vertices() - 1;
  hard_weight = other.weight[0];
  hard_end_is_held = other.soft_end_is_held;
  width.insert(width.begin(), other.width.rbegin(), other.width.rend());
  weight.insert(weight.begin(), other.weight.rbegin(), other.weight.rend() - 1);
}

double HeatGrid::capacity(int vertex, const Material& soft, const Material& hard) const {
  const double length = weight[static_cast<std::size_t>(vertex)];
  const double in_soft = soft.conductivity / soft.diffusivity;
  const double in_hard = hard.conductivity / hard.diffusivity;
  if (vertex != interface) return (vertex < interface ? in_hard : in_soft) * length;
  return in_soft * length + in_hard * hard_weight;
}

namespace {

struct Coupling {
  double before, after;  // coefficients a and c in the equation of a vertex, for its two neighbours (HeatOperator)
};

Coupling coupling(const HeatGrid& grid, const Material& soft, const Material& hard, double dt, std::size_t i) {
  const std::size_t interface = static_cast<std::size_t>(grid.interface);
  // A vertex that is held exchanges no heat in its own equation: its temperature stays.
  if ((grid.soft_end_is_held && i + 1 == grid.weight.size()) || (grid.hard_end_is_held && i == 0)) return {0.0, 0.0};
  if (i == interface && i > 0) {
    // Heat capacity of the vertex at z = 0, divided by dt  [W/(m2 K)].
    const double inertia = grid.capacity(grid.interface, soft, hard) / dt;
    return {hard.conductivity / (inertia * grid.width[i - 1]), soft.conductivity / (inertia * grid.width[i])};
  }
  const double diffused = (i < interface ? hard : soft).diffusivity * dt;  // diffusivity times step length  [m2]
  return {i == 0 ? 0.0 : diffused / (grid.weight[i] * grid.width[i - 1]),
          i + 1 == grid.weight.size() ? 0.0 : diffused / (grid.weight[i] * grid.width[i])};
}

}  // namespace

HeatOperator::HeatOperator(const HeatGrid& grid, double step) : dt(step), interface(grid.interface) {
  const std::size_t n = grid.weight.size();
  memory_ = std::make_unique_for_overwrite<double[]>(4 * n);
  inverse_pivot = {memory_.get(), n};
  inward = {memory_.get() + n, n};
  outward = {memory_.get() + 2 * n, n};
  response = {memory_.get() + 3 * n, n};
}

HeatOperator::HeatOperator(const HeatGrid& grid, const Material& soft, const Material& hard, double step)
    : HeatOperator(grid, step) {
  factorise(grid, soft, hard);
}

void HeatOperator::factorise(const HeatGrid& grid, const Material& soft, const Material& hard) {
  const std::size_t n = grid.weight.size();
  const std::size_t first = static_cast<std::size_t>(interface);

  // Eliminates vertex i, whose equation has the coefficients `inner` and `outer`. Its pivot is 1 + inner + outer *
  // (1 - outward[outer neighbour]). The lambda gets this difference as `kept_outside` and returns that of vertex i.
  const auto eliminate = [&](std::size_t i, double outer, double inner, double kept_outside) {
    const double own = 1.0 + outer * kept_outside;
    const double pivot = own + inner;
    inverse_pivot[i] = 1.0 / pivot;
    inward[i] = outer / pivot;
    outward[i] = inner / pivot;
    return own / pivot;
  };
  double kept = 0.0, kept_hard = 0.0;
  for (std::size_t i = n - 1; i > first; --i) {
    const auto [a, c] = coupling(grid, soft, hard, dt, i);
    kept = eliminate(i, c, a, kept);
  }
  for (std::size_t i = 0; i < first; ++i) {
    const auto [a, c] = coupling(grid, soft, hard, dt, i);
    kept_hard = eliminate(i, a, c, kept_hard);
  }
  const auto [a, c] = coupling(grid, soft, hard, dt, first);
  const double pivot = 1.0 + c * kept + a * kept_hard;
  inverse_pivot[first] = 1.0 / pivot;
  inward[first] = c / pivot;
  inward_hard = a / pivot;
  outward[first] = 0.0;

  // Temperature rise of the half cells at z = 0 by a unit flux: DLP (31) as MODEL.md corrects it, for any cell width.
  const double rise = first == 0 ? soft.diffusivity * dt / (grid.weight[0] * soft.conductivity)
                                 : dt / grid.capacity(interface, soft, hard);
  response[first] = rise * inverse_pivot[first];
  for (std::size_t i = first + 1; i < n; ++i) response[i] = outward[i] * response[i - 1];
  for (std::size_t i = first; i-- > 0;) response[i] = outward[i] * response[i + 1];
}

SpreadHeat::SpreadHeat(const HeatGrid& grid, double dt, int layer_vertices, const Material& soft,
                       const Material& hard) {
  for (int i = 0; i < layer_vertices; ++i) gain.push_back(dt / grid.capacity(grid.interface + i, soft, hard));
  // Heat at a held vertex leaves the body at once.
  if (grid.soft_end_is_held && grid.interface + layer_vertices == grid.num_vertices()) gain.back() = 0.0;
}

void respond(const HeatOperator& heat, const SpreadHeat& spread, const double* shape, double* response) {
  SHEARBUS_CALL(respond, heat, spread.gain, shape, response);
}

void add_spread(const HeatOperator& heat, const SpreadHeat& spread, const double (&flux)[kLanes],
                const double* response, double* temperature) {
  SHEARBUS_CALL(add_spread, heat, std::ssize(spread.gain), flux, response, temperature);
}

void respond_lane(const HeatOperator& heat, const SpreadHeat& spread, int lane, const double* shape, double* response) {
  one::respond(heat, spread.gain, shape + lane, response + lane);
}

void add_spread_lane(const HeatOperator& heat, const SpreadHeat& spread, int lane, double flux, const double* response,
                     double* temperature) {
  one::add_spread(heat, std::ssize(spread.gain), &flux, response + lane, temperature + lane);
}

void conduct(const HeatOperator& heat, int num_vertices, const double* before, double* after, std::ptrdiff_t next) {
  SHEARBUS_CALL(sweep, heat, num_vertices, before, after, next);
}

void conduct_lane(const HeatOperator& heat, int num_vertices, int lane, double* temperature) {
  one::sweep(heat, num_vertices, temperature + lane, temperature + lane, 0);
}

void conduct_rows(std::span<const double> decay, const double* before, double* after, double* sum) {
  SHEARBUS_CALL(decay_rows, decay, before, after, sum);
}

void add_to_rows(std::span<const double> gain, const double (&flux)[kLanes], double* rows) {
  SHEARBUS_CALL(add_rows, gain, flux, rows);
}

void extrapolate_rows(int num_rows, double factor, const double* before, double* rows) {
  SHEARBUS_CALL(extrapolate, num_rows, factor, before, rows);
}

void range_of_rows(std::ptrdiff_t num_rows, const double* rows, double (&lowest)[kLanes], double (&highest)[kLanes]) {
  SHEARBUS_CALL(find_range, num_rows, rows, lowest, highest);
}

std::uint32_t lanes_below(std::span<const double> gain, const double (&flux)[kLanes], const double (&bound)[kLanes],
                          const double* rows) {
  return SHEARBUS_CALL(find_below, gain, flux, bound, rows);
}

namespace {

// The rows that a flux changes. The outer vertices are left out where flux * B is too small to change T (B falls from
// z = 0 outwards). It is too small below 2^-54 T_end/2, where T_end is the temperature of the colder end: no vertex is
// colder than T_end/2, and half an ulp of T is more than 2^-54 T.
struct Rows {
  std::ptrdiff_t first, end;
};
Rows rows_that_feel(const HeatOperator& heat, double strongest, double coldest) {
  const double felt = 0x1p-55 * coldest;
  const auto unfelt = [&](double response) { return strongest * response < felt; };
  const auto interface = heat.response.begin() + heat.interface;
  return {std::partition_point(heat.response.begin(), interface, unfelt) - heat.response.begin(),
          std::partition_point(interface, heat.response.end(), std::not_fn(unfelt)) - heat.response.begin()};
}

}  // namespace

void add_flux(const HeatOperator& heat, int num_vertices, const double (&flux)[kLanes], double* temperature) {
  const double* end = temperature + std::ptrdiff_t{num_vertices - 1} * kLanes;
  double strongest = std::abs(flux[0]), coldest = std::min(temperature[0], end[0]);
  for (int l = 1; l < kLanes; ++l) {
    strongest = std::max(strongest, std::abs(flux[l]));
    coldest = std::min(coldest, std::min(temperature[l], end[l]));
  }
  const Rows rows = rows_that_feel(heat, strongest, coldest);
  add_to_rows(heat.response.subspan(rows.first, rows.end - rows.first), flux, temperature + rows.first * kLanes);
}

void add_flux_lane(const HeatOperator& heat, int num_vertices, int lane, double flux, double* temperature) {
  double* T = temperature + lane;
  const Rows rows = rows_that_feel(heat, std::abs(flux), std::min(T[0], T[std::ptrdiff_t{num_vertices - 1} * kLanes]));
  for (std::ptrdiff_t i = rows.first; i < rows.end; ++i) T[i * kLanes] += flux * heat.response[i];
}

}  // namespace shearbus::physics
