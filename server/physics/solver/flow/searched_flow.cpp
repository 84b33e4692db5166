#include "server/physics/solver/flow/searched_flow.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/flow/vertex_flow.hpp"

#define SHEARBUS_KERNELS "server/physics/solver/flow/searched_flow_kernel.hpp"
#include "server/physics/layer/each_register.hpp"

namespace shearbus::physics {

std::size_t searched_rows(const Grid& grid) {
  return static_cast<std::size_t>(grid.num_vertices()) * SearchedFlow::kTerms * kLanes;
}

void start_search(double* rows, SearchedFlow& flow) {
  flow.summed = false;
  std::fill_n(flow.stress, kLanes, 0.0);
  flow.rows = rows;
}

namespace {

// Sums the flow lane by lane, for laws without a kernel.
template <class Law>
void sum_by(LawType<Law>, const FlowProblem& problem, const FlowLoad& load, double* strain_new, SearchedFlow& flow) {
  const Law law(*problem.soft, problem.dt);
  for (int lane = 0; lane < kLanes; ++lane) {
    double slip = 0.0, slope = 0.0;
    for (std::ptrdiff_t i = 0; i < problem.grid->num_vertices(); ++i) {
      const std::ptrdiff_t at = i * kLanes + lane;
      const double response = problem.spread_response != nullptr ? problem.spread_response[at] : problem.response[i];
      const double rise = i < problem.num_heated ? load.flux[lane] * response : 0.0;
      const double ep = problem.strain[at];
      const FlowOfVertex found = flow_of_vertex(law, load, lane, problem.T_ad[at] + rise, rise, ep);
      const double weight = problem.grid->weight[static_cast<std::size_t>(i)];
      slip += weight * found.dep;
      slope += weight * found.slope;
      strain_new[at] = ep + found.dep;
    }
    flow.slip[lane] = slip;
    flow.slope[lane] = slope;
  }
}

// Laws with a kernel. That of Steinberg, Cochran and Guinan has an expanded flow and is not searched.
void sum_by(LawType<JohnsonCook>, const FlowProblem& problem, const FlowLoad& load, double* strain_new,
            SearchedFlow& flow) {
  SHEARBUS_CALL(sum_johnson_cook, problem, load, strain_new, flow);
}
void sum_by(LawType<PrestonTonksWallace>, const FlowProblem& problem, const FlowLoad& load, double* strain_new,
            SearchedFlow& flow) {
  SHEARBUS_CALL(sum_preston_tonks_wallace, problem, load, strain_new, flow);
}
void sum_by(LawType<SteinbergCochranGuinan>, const FlowProblem&, const FlowLoad&, double*, SearchedFlow&) {}

}  // namespace

void sum_flow(const FlowProblem& problem, const FlowLoad& load, double* strain_new, SearchedFlow& flow) {
  FlowLaws::with(problem.soft->flow_law, [&](auto law) { sum_by(law, problem, load, strain_new, flow); });
  std::copy_n(load.load, kLanes, flow.last_load);
  std::copy_n(load.flux, kLanes, flow.last_flux);
  flow.summed = true;
}

FlowAccuracy accuracy_of(const SearchedFlow& flow, int l) {
  constexpr double kDigits = 1e-14;  // of the searches at the vertices
  return {flow.slip[l], flow.slope[l], kDigits};
}

NearbyFlow nearby_flow(SearchedFlow& flow, double a, int l) {
  constexpr double kNear = 0.1, kMostCurvature = 1e4;  // of ln(a) between the two sums; of the curvature
  const double slip = flow.slip[l];
  if (!(slip > 0.0) || !(a > 0.0)) {
    flow.stress[l] = 0.0;
    return {.accuracy = accuracy_of(flow, l)};
  }
  NearbyFlow nearby{.base = a, .exponent = flow.slope[l] / slip, .moment = {slip}, .accuracy = accuracy_of(flow, l)};
  const double log_slip = logarithm(slip);
  if (flow.stress[l] > 0.0 && flow.stress[l] != a) {
    const double v = logarithm(flow.stress[l] / a);
    const double curvature = (flow.log_slip[l] - log_slip - nearby.exponent * v) / (v * v);
    if (std::abs(v) <= kNear && std::abs(curvature) <= kMostCurvature) nearby.curvature = curvature;
  }
  flow.stress[l] = a;
  flow.log_slip[l] = log_slip;
  return nearby;
}

}  // namespace shearbus::physics
