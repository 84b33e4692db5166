#include "server/physics/layer/conduction.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
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
  // Arithmetic means make a geometric grid (ln grading)^2/16 too stiff at all times; cells longer by this to heat undo
  // it.
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
  double before, after;  // a, c: what a step takes over from the neighbours
};

Coupling coupling(const HeatGrid& grid, const Material& soft, const Material& hard, double dt, std::size_t i) {
  const std::size_t interface = static_cast<std::size_t>(grid.interface);
  if (i == interface && i > 0) {
    const double inertia = grid.capacity(grid.interface, soft, hard) / dt;  // [W/(m2 K)]
    return {hard.conductivity / (inertia * grid.width[i - 1]), soft.conductivity / (inertia * grid.width[i])};
  }
  const double diffused = (i < interface ? hard : soft).diffusivity * dt;  // [m2]
  return {i == 0 ? 0.0 : diffused / (grid.weight[i] * grid.width[i - 1]),
          i + 1 == grid.weight.size() ? 0.0 : diffused / (grid.weight[i] * grid.width[i])};
}

}  // namespace

HeatOperator::HeatOperator(const HeatGrid& grid, double step) : dt(step), interface(grid.interface) {
  const std::size_t n = grid.weight.size();
  memory_ = std::make_unique_for_overwrite<double[]>(4 * n);
  forward = {memory_.get(), n};
  inverse_pivot = {memory_.get() + n, n};
  backward = {memory_.get() + 2 * n, n};
  response = {memory_.get() + 3 * n, n};
}

HeatOperator::HeatOperator(const HeatGrid& grid, const Material& soft, const Material& hard, double step)
    : HeatOperator(grid, step) {
  factorise(grid, soft, hard);
}

void HeatOperator::factorise(const HeatGrid& grid, const Material& soft, const Material& hard) {
  const std::size_t n = grid.weight.size();

  // pivot = 1 + excess + c, with excess = a (1 + excess before) / (pivot before): the elimination's 1 + a + c - a
  // c/pivot written without the difference.
  double excess = 0.0;
  double pivot_before = 1.0;
  for (std::size_t i = 0; i < n; ++i) {
    const auto [a, c] = coupling(grid, soft, hard, dt, i);
    excess = i == 0 ? 0.0 : a * (1.0 + excess) / pivot_before;
    const double pivot = 1.0 + excess + c;
    forward[i] = a / pivot;
    inverse_pivot[i] = 1.0 / pivot;
    backward[i] = c / pivot;
    pivot_before = pivot;
  }

  // Unit flux enters the half cells at z = 0: DLP (31), corrected, for any first width.
  const std::size_t first = static_cast<std::size_t>(interface);
  const double rise = first == 0 ? soft.diffusivity * dt / (grid.weight[0] * soft.conductivity)
                                 : dt / grid.capacity(interface, soft, hard);
  std::ranges::fill(response, 0.0);
  response[first] = rise * inverse_pivot[first];
  for (std::size_t i = first + 1; i < n; ++i) response[i] = forward[i] * response[i - 1];
  for (std::size_t i = n - 1; i-- > 0;) response[i] += backward[i] * response[i + 1];
}

SpreadHeat::SpreadHeat(const HeatGrid& grid, const HeatOperator& heat, int num_layer_vertices, const Material& soft,
                       const Material& hard)
    : layer_vertices(num_layer_vertices), gain(static_cast<std::size_t>(num_layer_vertices)) {
  for (int i = 0; i < layer_vertices; ++i) gain[i] = heat.dt / grid.capacity(heat.interface + i, soft, hard);

  // From the far end inwards, with kept = 1 - t[i+1]/t[i]: (1 + c kept + a) t[i] = a t[i-1].
  const std::size_t last = static_cast<std::size_t>(heat.interface + layer_vertices) - 1;
  outward.resize(grid.weight.size() - last - 1);
  double kept = 0.0;
  for (std::size_t i = grid.weight.size() - 1; i > last; --i) {
    const auto [a, c] = coupling(grid, soft, hard, heat.dt, i);
    const double own = 1.0 + c * kept;
    outward[i - last - 1] = a / (own + a);
    kept = own / (own + a);
  }
  // HeatOperator's elimination up to the layer's last vertex, whose c t[i+1] is c (1 - kept) t[i].
  double excess = 0.0;
  double pivot = 1.0;
  for (std::size_t i = 0; i <= last; ++i) {
    const auto [a, c] = coupling(grid, soft, hard, heat.dt, i);
    excess = i == 0 ? 0.0 : a * (1.0 + excess) / pivot;
    pivot = 1.0 + excess + (i < last ? c : c * kept);
    last_forward = a / pivot;
  }
  last_inverse_pivot = 1.0 / pivot;
}

void respond(const HeatOperator& heat, const SpreadHeat& spread, const double* shape, double* response) {
  const double* forward = heat.forward.data() + heat.interface;
  const double* inverse_pivot = heat.inverse_pivot.data() + heat.interface;
  const double* backward = heat.backward.data() + heat.interface;
  const std::ptrdiff_t last = spread.layer_vertices - 1;
  double t[kLanes] = {};
  for (std::ptrdiff_t i = 0; i <= last; ++i) {
    const double gained = spread.gain[i] * (i < last ? inverse_pivot[i] : spread.last_inverse_pivot);
    const double carried = i < last ? forward[i] : spread.last_forward;
    for (int l = 0; l < kLanes; ++l) {
      t[l] = shape[i * kLanes + l] * gained + carried * t[l];
      response[i * kLanes + l] = t[l];
    }
  }
  for (std::ptrdiff_t i = last; i-- > 0;) {
    for (int l = 0; l < kLanes; ++l) {
      t[l] = response[i * kLanes + l] + backward[i] * t[l];
      response[i * kLanes + l] = t[l];
    }
  }
}

void add_spread(const HeatOperator& heat, const SpreadHeat& spread, const double (&flux)[kLanes],
                const double* response, double* temperature) {
  const std::ptrdiff_t interface = heat.interface;
  const std::ptrdiff_t last = spread.layer_vertices - 1;
  double* layer = temperature + interface * kLanes;
  for (std::ptrdiff_t i = 0; i <= last; ++i) {
    for (int l = 0; l < kLanes; ++l) layer[i * kLanes + l] += flux[l] * response[i * kLanes + l];
  }
  double t[kLanes];
  for (int l = 0; l < kLanes; ++l) t[l] = flux[l] * response[l];
  for (std::ptrdiff_t i = interface; i-- > 0;) {
    for (int l = 0; l < kLanes; ++l) {
      t[l] *= heat.backward[i];
      temperature[i * kLanes + l] += t[l];
    }
  }
  for (int l = 0; l < kLanes; ++l) t[l] = flux[l] * response[last * kLanes + l];
  for (std::size_t j = 0; j < spread.outward.size(); ++j) {
    double* row = layer + (last + 1 + static_cast<std::ptrdiff_t>(j)) * kLanes;
    for (int l = 0; l < kLanes; ++l) {
      t[l] *= spread.outward[j];
      row[l] += t[l];
    }
  }
}

namespace {

bool is_uniform(int num_vertices, const double* temperature) {
  for (std::ptrdiff_t i = 1; i < num_vertices; ++i) {
    bool same = true;
    for (int l = 0; l < kLanes; ++l) same = same && temperature[i * kLanes + l] == temperature[l];
    if (!same) return false;
  }
  return true;
}

}  // namespace

// Both sweeps work on the temperature above that of the colder end, the coldest there is: a uniform layer stays uniform
// to the last bit and no vertex falls below the coldest by rounding.
void conduct(const HeatOperator& heat, int num_vertices, const double* before, double* after) {
  if (is_uniform(num_vertices, before)) {
    std::copy_n(before, std::ptrdiff_t{num_vertices} * kLanes, after);
    return;
  }
  const double* forward = heat.forward.data();
  const double* inverse_pivot = heat.inverse_pivot.data();
  const double* backward = heat.backward.data();
  const std::ptrdiff_t n = num_vertices;
  double far[kLanes];
  double t[kLanes] = {};
  for (int l = 0; l < kLanes; ++l) far[l] = std::min(before[l], before[(n - 1) * kLanes + l]);
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    for (int l = 0; l < kLanes; ++l) {
      t[l] = (before[i * kLanes + l] - far[l]) * inverse_pivot[i] + forward[i] * t[l];
      after[i * kLanes + l] = t[l];
    }
  }
  for (int l = 0; l < kLanes; ++l) after[(n - 1) * kLanes + l] = far[l] + t[l];
  for (std::ptrdiff_t i = n - 1; i-- > 0;) {
    for (int l = 0; l < kLanes; ++l) {
      t[l] = after[i * kLanes + l] + backward[i] * t[l];
      after[i * kLanes + l] = far[l] + t[l];
    }
  }
}

void conduct_lane(const HeatOperator& heat, int num_vertices, int lane, double* temperature) {
  const std::ptrdiff_t n = num_vertices;
  double* T = temperature + lane;
  const double far = std::min(T[0], T[(n - 1) * kLanes]);
  double t = 0.0;
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    t = (T[i * kLanes] - far) * heat.inverse_pivot[i] + heat.forward[i] * t;
    T[i * kLanes] = t;
  }
  T[(n - 1) * kLanes] = far + t;
  for (std::ptrdiff_t i = n - 1; i-- > 0;) {
    t = T[i * kLanes] + heat.backward[i] * t;
    T[i * kLanes] = far + t;
  }
}

void add_flux(const HeatOperator& heat, int num_vertices, const double (&flux)[kLanes], double* temperature) {
  double strongest = 0.0;
  double coldest = temperature[0];
  for (int l = 0; l < kLanes; ++l) {
    strongest = std::max(strongest, std::abs(flux[l]));
    coldest = std::min({coldest, temperature[l], temperature[std::ptrdiff_t{num_vertices - 1} * kLanes + l]});
  }
  // B falls from z = 0 outwards. Half an ulp of T is more than 2^-54 T, and no vertex is half as warm as the ends are.
  const double felt = 0x1p-55 * coldest;
  const auto unfelt = [&](double response) { return strongest * response < felt; };
  const std::ptrdiff_t first =
      std::partition_point(heat.response.begin(), heat.response.begin() + heat.interface, unfelt) -
      heat.response.begin();
  const std::ptrdiff_t end = std::partition_point(heat.response.begin() + heat.interface,
                                                  heat.response.begin() + num_vertices, std::not_fn(unfelt)) -
                             heat.response.begin();
  for (std::ptrdiff_t i = first; i < end; ++i) {
    for (int l = 0; l < kLanes; ++l) temperature[i * kLanes + l] += flux[l] * heat.response[i];
  }
}

void add_flux_lane(const HeatOperator& heat, int num_vertices, int lane, double flux, double* temperature) {
  for (std::ptrdiff_t i = 0; i < num_vertices; ++i) temperature[i * kLanes + lane] += flux * heat.response[i];
}

}  // namespace shearbus::physics
