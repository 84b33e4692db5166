#include "server/physics/solver/flow/layer_flow.hpp"

#include <cmath>
#include <cstddef>
#include <limits>

#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/flow/vertex_flow.hpp"

namespace shearbus::physics {

NearbyFlow::Slip NearbyFlow::at(double stress, double flux) const {
  const double w = base_flux > 0.0 ? flux / base_flux - 1.0 : 0.0;
  const double hot = moment[0] + w * (moment[1] + w * (moment[2] + w * moment[3]));
  const double hotter = moment[1] + w * (2.0 * moment[2] + w * (3.0 * moment[3]));
  const double v = logarithm(stress / base);
  const double y = exponential(v * (exponent + curvature * v));
  return {y * hot + constant, (exponent + 2.0 * curvature * v) * y * hot / stress,
          base_flux > 0.0 ? y * hotter / base_flux : 0.0};
}

bool is_balanced(double a, double left, double compliance, double slip, const FlowAccuracy& accuracy) {
  constexpr double kClosed = 1e-11;   // largest accepted residual, relative to what the flow must be
  constexpr double kRounded = 2e-15;  // rounding error of `hot`
  const double flow = compliance * slip;
  double open = kClosed * left + kRounded * (compliance * accuracy.hot);
  if (flow <= 2.0 * left) open += accuracy.digits * (compliance * accuracy.slope + a);
  return std::abs(flow - left) <= open;
}

int num_heated_vertices(const Grid& grid, const double* response) {
  // A vertex with a response below this fraction of the response at z = 0 warms by less than the last digit of T.
  constexpr double kLost = 1e-17;
  int n = grid.num_vertices();
  while (n > 1 && response[n - 1] < kLost * response[0]) --n;
  return n;
}

void set_load(const Material& soft, double pressure, double a, double flux, int lane, FlowLoad& load) {
  FlowLaws::with(soft.flow_law, [&](auto law) {
    using Law = typename decltype(law)::type;
    const bool loads = kSqrt3 * a / Law::unit_of_load(soft) >= std::numeric_limits<double>::min();
    load.load[lane] = loads ? Law(soft, 1.0).load_of(a) : kNoLoad;
    load.bracket[lane] = Law::bracket_at(soft, pressure);
  });
  load.flux[lane] = flux;
  load.T_melt[lane] = soft.melting_temperature;
}

double flow_of_lane(const FlowProblem& problem, const FlowLoad& load, int lane, double* strain_new) {
  return FlowLaws::with(problem.soft->flow_law, [&](auto own) {
    const typename decltype(own)::type law(*problem.soft, problem.dt);
    double slip = 0.0;
    for (std::ptrdiff_t i = 0; i < problem.grid->num_vertices(); ++i) {
      const std::ptrdiff_t at = i * kLanes + lane;
      const double response = problem.spread_response != nullptr ? problem.spread_response[at] : problem.response[i];
      const double rise = load.flux[lane] * response;
      const double old = problem.strain[at];
      const double dep = flow_of_vertex(law, load, lane, problem.T_ad[at] + rise, rise, old).dep;
      slip += problem.grid->weight[static_cast<std::size_t>(i)] * dep;
      if (strain_new != nullptr) strain_new[at] = old + dep;
    }
    return slip;
  });
}

}  // namespace shearbus::physics
