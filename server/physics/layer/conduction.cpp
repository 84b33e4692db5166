#include "server/physics/layer/conduction.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <experimental/simd>
#include <functional>

namespace shearbus::physics {

HeatGrid::HeatGrid(const Grid& grid, FarBoundary far_boundary) : width(grid.width) {
  if (far_boundary == FarBoundary::kHalfSpace) {
    const double ratio = grid.matched ? std::max(grid.grading, kLeastMatchedGrading) : kExtensionGrading;
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
      weight.push_back(grid.matched ? 0.5 * (width[i - 1] + width[i]) : std::sqrt(width[i - 1] * width[i]));
    }
    weight.push_back(0.5 * width.back());
  }
  if (!grid.matched) return;
  // Each vertex of this graded grid holds the heat of one half of each of its two cells. T0 would therefore rise less
  // under a flux than in the continuum, by the fraction (ln grading)^2/16. Longer conduction lengths compensate this.
  const double stretch = 0.5 * (1.0 + grid.grading) / std::sqrt(grid.grading);
  for (double& cell : width) cell *= stretch;
}

HeatGrid::HeatGrid(const Grid& soft, FarBoundary far_boundary, const Grid& hard, FarBoundary hard_far_boundary)
    : HeatGrid(soft, far_boundary) {
  const HeatGrid other(hard, hard_far_boundary);
  interface = other.num_vertices() - 1;
  hard_weight = other.weight[0];
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
}

namespace {

// Values of kWidth neighbouring lanes, as SIMD vectors: the compiler does not vectorise a loop over lanes inside a
// recurrence over vertices.
template <int kWidth>
using Row = std::experimental::fixed_size_simd<double, kWidth>;

template <int kWidth = kLanes>
Row<kWidth> load(const double* lanes) {
  return Row<kWidth>(lanes, std::experimental::element_aligned);
}

template <class Row>
void store(const Row& row, double* lanes) {
  row.copy_to(lanes, std::experimental::element_aligned);
}

}  // namespace

void respond(const HeatOperator& heat, const SpreadHeat& spread, const double* shape, double* response) {
  const double* inverse_pivot = heat.inverse_pivot.data() + heat.interface;
  const double* inward = heat.inward.data() + heat.interface;
  const double* outward = heat.outward.data() + heat.interface;
  const auto num_vertices = static_cast<std::ptrdiff_t>(spread.gain.size());
  Row<kLanes> t = 0.0;
  for (std::ptrdiff_t i = num_vertices; i-- > 0;) {
    t = load(shape + i * kLanes) * (spread.gain[static_cast<std::size_t>(i)] * inverse_pivot[i]) + inward[i] * t;
    store(t, response + i * kLanes);
  }
  for (std::ptrdiff_t i = 1; i < num_vertices; ++i) {
    t = load(response + i * kLanes) + outward[i] * t;
    store(t, response + i * kLanes);
  }
}

void add_spread(const HeatOperator& heat, const SpreadHeat& spread, const double (&flux)[kLanes],
                const double* response, double* temperature) {
  const std::ptrdiff_t interface = heat.interface;
  const std::ptrdiff_t end = interface + static_cast<std::ptrdiff_t>(spread.gain.size());
  const auto add = [&](std::ptrdiff_t i, const Row<kLanes>& t) {
    store(load(temperature + i * kLanes) + t, temperature + i * kLanes);
  };
  const Row<kLanes> q = load(flux);
  Row<kLanes> t = q * load(response);
  for (std::ptrdiff_t i = interface; i-- > 0;) add(i, t *= heat.outward[i]);
  for (std::ptrdiff_t i = interface; i < end; ++i) add(i, t = q * load(response + (i - interface) * kLanes));
  for (std::ptrdiff_t i = end; i < std::ssize(heat.outward); ++i) add(i, t *= heat.outward[i]);
}

namespace {

// The vertices of one body, without z = 0.
struct Arm {
  // Outermost vertex that is not at the far temperature (that of the colder end) in every lane; z = 0 if none.
  std::ptrdiff_t heated;
  std::ptrdiff_t outermost;  // outermost vertex of the body
  std::ptrdiff_t outwards;   // step to the next outer vertex: 1 or -1
};

// The elimination and substitution of a step without heat flux, in place. They work on the temperature above `far`, the
// temperature of the colder end, so that a uniform layer stays uniform to the last bit and rounding cools no vertex
// below the coldest one.
template <int kWidth>
class Sweeps {
 public:
  Sweeps(const HeatOperator& heat, const Row<kWidth>& far, double* temperature)
      : far_(far), heat_(heat), T_(temperature) {}

  // Eliminates from the outermost heated vertex inwards to the neighbour of z = 0. Vertices farther out are at the
  // temperature `far` and contribute nothing.
  Row<kWidth> eliminate(Arm arm) const {
    Row<kWidth> t = 0.0;
    for (std::ptrdiff_t i = arm.heated; i != heat_.interface; i -= arm.outwards) {
      t = (at(i) - far_) * heat_.inverse_pivot[i] + heat_.inward[i] * t;
      put(i, t);
    }
    return t;
  }

  // Solves the vertex at z = 0 from the eliminations of both bodies.
  Row<kWidth> meet(const Row<kWidth>& from_soft, const Row<kWidth>& from_hard) const {
    const std::ptrdiff_t i = heat_.interface;
    Row<kWidth> t =
        (at(i) - far_) * heat_.inverse_pivot[i] + heat_.inward[i] * from_soft + heat_.inward_hard * from_hard;
    put(i, far_ + t);
    return t;
  }

  // Substitutes outwards from z = 0, where the temperature above `far` is `t`. Beyond the heated vertices this value
  // decays; the loop ends where it no longer changes the temperature of any lane.
  void substitute(Arm arm, Row<kWidth> t) const {
    std::ptrdiff_t i = heat_.interface;
    while (i != arm.heated) {
      i += arm.outwards;
      t = at(i) + heat_.outward[i] * t;
      put(i, far_ + t);
    }
    for (bool felt = true; felt && i != arm.outermost;) {
      i += arm.outwards;
      t *= heat_.outward[i];
      felt = any_of(far_ + t != far_);
      put(i, far_ + t);
    }
  }

 private:
  Row<kWidth> at(std::ptrdiff_t i) const { return load<kWidth>(T_ + i * kLanes); }
  void put(std::ptrdiff_t i, const Row<kWidth>& row) const { store(row, T_ + i * kLanes); }

  Row<kWidth> far_;
  const HeatOperator& heat_;
  double* T_;
};

template <int kWidth>
void sweep(const HeatOperator& heat, int num_vertices, const double* before, double* after) {
  const std::ptrdiff_t interface = heat.interface;
  const std::ptrdiff_t last = num_vertices - 1;
  const Row<kWidth> far = min(load<kWidth>(before), load<kWidth>(before + last * kLanes));

  // 1. Copy the old temperatures and find how far heat has come. The loop reads in ascending addresses: reading inwards
  // from the far ends is a quarter slower when the states exceed the cache.
  Arm soft{interface, last, 1}, hard{interface, 0, -1};
  for (std::ptrdiff_t i = 0; i <= last; ++i) {
    const Row<kWidth> T = load<kWidth>(before + i * kLanes);
    store(T, after + i * kLanes);
    if (all_of(T == far)) continue;
    hard.heated = std::min(hard.heated, i);
    soft.heated = std::max(soft.heated, i);
  }

  // 2. Sweep over the heated vertices only, which gives the same bits as a sweep over all vertices.
  const Sweeps<kWidth> sweeps(heat, far, after);
  const Row<kWidth> from_soft = sweeps.eliminate(soft);
  const Row<kWidth> from_hard = sweeps.eliminate(hard);
  const Row<kWidth> t = sweeps.meet(from_soft, from_hard);
  sweeps.substitute(soft, t);
  sweeps.substitute(hard, t);
}

}  // namespace

[[gnu::flatten]] void conduct(const HeatOperator& heat, int num_vertices, const double* before, double* after) {
  sweep<kLanes>(heat, num_vertices, before, after);
}

void conduct_lane(const HeatOperator& heat, int num_vertices, int lane, double* temperature) {
  sweep<1>(heat, num_vertices, temperature + lane, temperature + lane);
}

namespace {

// Adds flux * B to the temperature T, but skips the outer vertices, where flux * B is too small to change T (B falls
// from z = 0 outwards). It is too small below 2^-54 T_end/2, where T_end is the temperature of the colder end: no
// vertex is colder than T_end/2, and half an ulp of T is more than 2^-54 T.
template <int kWidth>
void add(const HeatOperator& heat, int num_vertices, const Row<kWidth>& flux, double* temperature) {
  const double strongest = hmax(abs(flux));
  const double coldest =
      hmin(min(load<kWidth>(temperature), load<kWidth>(temperature + std::ptrdiff_t{num_vertices - 1} * kLanes)));
  const double felt = 0x1p-55 * coldest;
  const auto unfelt = [&](double response) { return strongest * response < felt; };
  const auto interface = heat.response.begin() + heat.interface;
  const std::ptrdiff_t first = std::partition_point(heat.response.begin(), interface, unfelt) - heat.response.begin();
  const std::ptrdiff_t end =
      std::partition_point(interface, heat.response.end(), std::not_fn(unfelt)) - heat.response.begin();
  for (std::ptrdiff_t i = first; i < end; ++i) {
    double* T = temperature + i * kLanes;
    store(load<kWidth>(T) + flux * heat.response[i], T);
  }
}

}  // namespace

void add_flux(const HeatOperator& heat, int num_vertices, const double (&flux)[kLanes], double* temperature) {
  add(heat, num_vertices, load(flux), temperature);
}

void add_flux_lane(const HeatOperator& heat, int num_vertices, int lane, double flux, double* temperature) {
  add(heat, num_vertices, Row<1>(flux), temperature + lane);
}

}  // namespace shearbus::physics
