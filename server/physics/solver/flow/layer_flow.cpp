#include "server/physics/solver/flow/layer_flow.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>

#include "server/physics/material/flow_laws.hpp"

#define SHEARBUS_KERNELS "server/physics/solver/flow/layer_flow_kernel.hpp"
#include "server/physics/layer/each_register.hpp"

namespace shearbus::physics {

void find_first_vertices(const LaneMaterials& soft_at, std::uint32_t lanes, const double* pressure, const double* T,
                         const double* strain, FirstVertices& found) {
  if (soft_at.uniform() && !is_one_lane(lanes)) {
    SHEARBUS_CALL(find_first_vertices, soft_at(0), 0, kLanes, pressure, T, strain, found);
  } else {
    for (const int l : lanes_of(lanes)) one::find_first_vertices(soft_at(l), l, l + 1, pressure, T, strain, found);
  }
}

LayerFlow::LayerFlow(const FlowProblem& layers, double* rows)
    : problem(layers), rows_of_vertices(rows), is_explicit(has_explicit_flow(layers.soft->flow_law)) {
  FlowLaws::with(problem.soft->flow_law, [&](auto own) {
    using Law = typename decltype(own)::type;
    if constexpr (ExplicitFlow<Law>) exponent = Law::exponent(*problem.soft);
  });
  searched.summed = false;
  expanded.bounds.rows = (problem.grid->num_vertices() + FlowBounds::kBlocks - 1) / FlowBounds::kBlocks;
  std::fill_n(searched.stress, kLanes, 0.0);
  std::fill_n(expanded.base, kLanes, 0.0);
  std::fill_n(expanded.base_heating, kLanes, 0.0);
  for (int l = 0; l < kLanes; ++l) {
    forget(l);
    load(l, *problem.soft, 0.0, 0.0, 0.0);
  }
}

void LayerFlow::forget(int lane) {
  bounds_known &= ~(1u << lane);
  expanded.origin[lane] = -1.0;
  expanded.origin_flux[lane] = expanded.steepest[lane] = 0.0;
  searched.last_flux[lane] = -1.0;
}

void LayerFlow::sum(std::uint32_t lanes, double* strain_new) {
  const bool alone = is_one_lane(lanes);
  const int first = alone ? std::countr_zero(lanes) : 0, end = alone ? first + 1 : kLanes;
  if (alone) {
    one::sum_flow(*this, first, end, strain_new);
  } else {
    SHEARBUS_CALL(sum_flow, *this, first, end, strain_new);
  }
  searched.summed = true;
}

NearbyFlow LayerFlow::nearby_searched(int l) {
  constexpr double kNear = 0.1, kMostCurvature = 1e4;  // of ln(a) between the two sums; of the curvature
  const double a = stress[l];
  double& last = searched.stress[l];
  double& last_log_slip = searched.log_slip[l];
  if (!(slip[l] > 0.0) || !(a > 0.0)) {
    last = 0.0;
    return {};
  }
  // A power of the stress with a curvature through the last two sums.
  NearbyFlow flow{.base = a, .exponent = slope[l] / slip[l], .moment = {slip[l]}};
  const double log_slip = logarithm(slip[l]);
  if (last > 0.0 && last != a) {
    const double v = logarithm(last / a);
    const double curvature = (last_log_slip - log_slip - flow.exponent * v) / (v * v);
    if (std::abs(v) <= kNear && std::abs(curvature) <= kMostCurvature) flow.curvature = curvature;
  }
  last = a;
  last_log_slip = log_slip;
  return flow;
}

namespace {

// The stress that meets the balance of a lane with the flow nearby, by Newton's method.
double root_nearby(const NearbyFlow& nearby, double a, double compliance, double a_trial) {
  constexpr int kMostSteps = 20;
  constexpr double kMet = 1e-13;
  constexpr double kFarAbove = 100.0;  // flow that relieves more than this multiple of a_trial is too far from the root
  if (!(nearby.base > 0.0) || compliance * nearby.moment[0] > kFarAbove * a_trial) return -1.0;
  for (int step = 0; step < kMostSteps; ++step) {
    const NearbyFlow::Slip slip = nearby.at(a, 0.0);
    const double change = -(a + compliance * slip.value - a_trial) / (1.0 + compliance * slip.by_stress);
    a += change;
    if (!(a > 0.0)) return -1.0;
    if (std::abs(change) <= kMet * a) break;
  }
  return a;
}

}  // namespace

void LayerFlow::find_roots(std::uint32_t lanes, double compliance, const double (&a_trial)[kLanes],
                           double (&root)[kLanes]) {
  if (is_explicit) {
    SHEARBUS_CALL(find_roots, *this, compliance, a_trial, root);
  } else {
    for (const int l : lanes_of(lanes)) root[l] = root_nearby(nearby(l), stress[l], compliance, a_trial[l]);
  }
}

}  // namespace shearbus::physics
