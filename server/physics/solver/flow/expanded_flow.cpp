#include "server/physics/solver/flow/expanded_flow.hpp"

#include <algorithm>
#include <cstddef>

#include "server/physics/material/flow_laws.hpp"

#define SHEARBUS_KERNELS "server/physics/solver/flow/expanded_flow_kernel.hpp"
#include "server/physics/layer/each_register.hpp"

namespace shearbus::physics {

bool has_expanded_flow(const Material& soft) {
  return soft.flow_law == FlowLaws::place<SteinbergCochranGuinan>();
}

bool carries_stress(const Material& soft, double pressure, double T) {
  return SteinbergCochranGuinan::carries_stress(soft, pressure, T);
}

bool searches_unbounded(const Material& soft, double T) {
  constexpr double kMostExponent = 10.0;  // of the melting factor exp(-0.001 T / (T_melt - T))
  return kMeltingFactor * T <= kMostExponent * (soft.melting_temperature - T);
}

void set_load(const Material& soft, double pressure, double a, double heating, int lane, StressLoad& load) {
  load.stress[lane] = load.base[lane] = a;
  load.heating[lane] = load.base_heating[lane] = heating;
  load.bracket[lane] = SteinbergCochranGuinan::bracket_at(soft, pressure);
  load.T_melt[lane] = soft.melting_temperature;
}

std::size_t rows_of(const Grid& grid) {
  return static_cast<std::size_t>(grid.num_vertices()) * ExpandedFlow::kTerms * kLanes;
}

void start_flow(const FlowProblem& problem, double* rows, ExpandedFlow& flow) {
  std::fill_n(flow.origin, kLanes, -1.0);
  std::fill_n(flow.origin_flux, kLanes, 0.0);
  std::fill_n(flow.steepest, kLanes, 0.0);
  flow.exponent = 1.0 / problem.soft->hardening_exponent;
  flow.rows = rows;
  SHEARBUS_CALL(find_bounds, problem, flow.bounds);
}

void sum_flow(const FlowProblem& problem, StressLoad& load, double* strain_new, ExpandedFlow& flow) {
  SHEARBUS_CALL(sum_flow, problem, load, strain_new, flow);
}

FlowAccuracy accuracy_of(const ExpandedFlow& flow, int l) {
  constexpr double kDigits = 2e-15;
  return {flow.moment[0][l], flow.slope[l], kDigits};
}

NearbyFlow nearby_flow(const ExpandedFlow& flow, const StressLoad& load, int l) {
  NearbyFlow nearby{.base = load.base[l],
                    .base_flux = load.base_heating[l] * load.base[l],
                    .exponent = flow.exponent,
                    .moment = {flow.moment[0][l], flow.moment[1][l], flow.moment[2][l], flow.moment[3][l]},
                    .accuracy = accuracy_of(flow, l)};
  const double w = flow.w[l];
  const double* m = nearby.moment;
  nearby.constant = flow.slip[l] - flow.y[l] * (m[0] + w * (m[1] + w * (m[2] + w * m[3])));
  return nearby;
}

void roots_of(const ExpandedFlow& flow, const StressLoad& load, double compliance, const double (&a_trial)[kLanes],
              double (&root)[kLanes]) {
  SHEARBUS_CALL(find_roots, flow, load, compliance, a_trial, root);
}

}  // namespace shearbus::physics
