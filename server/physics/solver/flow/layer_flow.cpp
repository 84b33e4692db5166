#include "server/physics/solver/flow/layer_flow.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "server/physics/layer/wide.hpp"
#include "server/physics/material/flow_laws.hpp"

namespace shearbus::physics {
namespace {

inline bool any_positive(const double (&value)[kLanes]) {
  double largest = value[0];
  for (int l = 1; l < kLanes; ++l) largest = value[l] > largest ? value[l] : largest;
  return largest > 0.0;
}

// Computes the temperature of vertex i in each lane after the heat of the step. A flow law that couples rate and
// temperature needs it at every vertex. A separable law needs it only where the heat of the step arrives, because the
// yield threshold of any other vertex already accounts for its temperature.
template <class Law, bool kSpread>
[[gnu::always_inline]] inline void load_vertices(const FlowProblem& problem, const FlowLoad& load, std::ptrdiff_t i,
                                                 LoadedVertices<kLanes>& vertices) {
  const double* T_ad = problem.T_ad + i * kLanes;
  const bool is_heated = i < problem.num_heated;
  const double B = kSpread || !is_heated ? 0.0 : problem.response[i];
  for (int l = 0; l < kLanes; ++l) {
    vertices.rise[l] = load.flux[l] * (kSpread && is_heated ? problem.spread_response[i * kLanes + l] : B);
    vertices.T[l] = T_ad[l] + vertices.rise[l];
  }
}

// Each law gets a function of its own: a function for all laws would leave fewer registers to the code of each.
template <class Law, bool kWrite, bool kSpread>
SHEARBUS_WIDE void flow(const FlowProblem& problem, const FlowLoad& load, std::ptrdiff_t num_rows,
                        const double* threshold, double* strain_new, FlowSum& sum) {
  const Law law(*problem.soft, problem.dt);
  const std::ptrdiff_t heated = problem.num_heated;
  std::ptrdiff_t num_yielding = 0;
  double slip[kLanes] = {};
  double slope[kLanes] = {};
  for (std::ptrdiff_t i = 0; i < num_rows; ++i) {
    const double* strain = problem.strain + i * kLanes;
    const double* yield = threshold + i * kLanes;
    alignas(64) double excess[kLanes];
    alignas(64) double growth[kLanes] = {};  // derivative of the softening excess by ln(stress)
    [[maybe_unused]] LoadedVertices<kLanes> vertices{load.load, load.bracket, load.T_melt, {}, {}};
    if constexpr (!Law::kSeparable) {
      load_vertices<Law, kSpread>(problem, load, i, vertices);
      if (i < heated) {
        for (int l = 0; l < kLanes; ++l)
          excess[l] = load.load[l] - law.strength_at_rest(load.bracket[l], load.T_melt[l], vertices.T[l], strain[l]);
      } else {
        for (int l = 0; l < kLanes; ++l) excess[l] = load.load[l] - yield[l];
      }
    } else if (i < heated) {
      const double B = kSpread ? 0.0 : problem.response[i];
      const double* B_lane = kSpread ? problem.spread_response + i * kLanes : nullptr;
      const double* T_ad = problem.T_ad + i * kLanes;
      for (int l = 0; l < kLanes; ++l) {
        const double rise = load.flux[l] * (kSpread ? B_lane[l] : B);
        const SofteningExcess softened = law.softening_excess(load.bracket[l], load.T_melt[l], T_ad[l] + rise);
        growth[l] = rise * softened.rate;
        excess[l] = (load.load[l] + softened.value) - yield[l];
      }
    } else {
      for (int l = 0; l < kLanes; ++l) excess[l] = load.load[l] - yield[l];
    }
    if (any_positive(excess)) {
      num_yielding = i + 1;
      const double w = problem.grid->weight[static_cast<std::size_t>(i)];
      const auto take = [&](int l, double flows, double rate) __attribute__((always_inline)) {
        slip[l] += w * flows;
        slope[l] += w * rate;
        if (kWrite) strain_new[i * kLanes + l] = strain[l] + flows;
      };
      if constexpr (Law::kSeparable) {
        law.flow(excess, growth, strain, take);
      } else {
        law.flow(vertices, excess, strain, take);
      }
    } else if (kWrite) {
      for (int l = 0; l < kLanes; ++l) strain_new[i * kLanes + l] = strain[l];
    }
  }
  for (int l = 0; l < kLanes; ++l) {
    sum.slip[l] = slip[l];
    sum.slope[l] = slope[l];
  }
  sum.num_yielding = static_cast<int>(num_yielding);
}

template <bool kWrite>
void flow(const FlowProblem& problem, const FlowLoad& load, int num_rows, const double* threshold, double* strain_new,
          FlowSum& sum) {
  FlowLaws::with(problem.soft->flow_law, [&](auto law) {
    using Law = typename decltype(law)::type;
    if (problem.spread_response == nullptr) {
      flow<Law, kWrite, false>(problem, load, num_rows, threshold, strain_new, sum);
    } else {
      flow<Law, kWrite, true>(problem, load, num_rows, threshold, strain_new, sum);
    }
  });
}

template <class Law>
SHEARBUS_WIDE void thresholds(const FlowProblem& problem, const FlowLoad& load, double* threshold) {
  const Law law(*problem.soft, problem.dt);
  const std::ptrdiff_t n = problem.grid->num_vertices();
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const double* strain = problem.strain + i * kLanes;
    const double* T_ad = problem.T_ad + i * kLanes;
    double* yield = threshold + i * kLanes;
    if constexpr (Law::kSeparable) {
      for (int l = 0; l < kLanes; ++l) yield[l] = law.log_strength(strain[l]);
      if (i < problem.num_heated) continue;
      for (int l = 0; l < kLanes; ++l) yield[l] -= law.softening_excess(load.bracket[l], load.T_melt[l], T_ad[l]).value;
    } else {
      if (i < problem.num_heated) continue;
      for (int l = 0; l < kLanes; ++l)
        yield[l] = law.strength_at_rest(load.bracket[l], load.T_melt[l], T_ad[l], strain[l]);
    }
  }
}

}  // namespace

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

void flow_thresholds(const FlowProblem& problem, const FlowLoad& load, double* threshold) {
  FlowLaws::with(problem.soft->flow_law,
                 [&](auto law) { thresholds<typename decltype(law)::type>(problem, load, threshold); });
}

namespace {

// Returns the plastic strain increment dep of one vertex at the temperature T. Its derivative is not computed.
template <class Law>
double flow_of_vertex(const Law& law, const FlowLoad& load, int lane, double T, double strain) {
  double dep = 0.0;
  const auto take = [&](int, double flows, double /*slope*/) { dep = flows; };
  if constexpr (Law::kSeparable) {
    const double excess[] = {(load.load[lane] + law.softening_excess(load.bracket[lane], load.T_melt[lane], T).value) -
                             law.log_strength(strain)};
    const double growth[] = {0.0};
    if (excess[0] > 0.0) law.flow(excess, growth, &strain, take);
  } else {
    const double excess[] = {load.load[lane] - law.strength_at_rest(load.bracket[lane], load.T_melt[lane], T, strain)};
    const LoadedVertices<1> vertex{load.load + lane, load.bracket + lane, load.T_melt + lane, {T}, {0.0}};
    if (excess[0] > 0.0) law.flow(vertex, excess, &strain, take);
  }
  return dep;
}

}  // namespace

double flow_of_lane(const FlowProblem& problem, const FlowLoad& load, int lane, double* strain_new) {
  return FlowLaws::with(problem.soft->flow_law, [&](auto own) {
    const typename decltype(own)::type law(*problem.soft, problem.dt);
    double slip = 0.0;
    for (std::ptrdiff_t i = 0; i < problem.grid->num_vertices(); ++i) {
      const std::ptrdiff_t at = i * kLanes + lane;
      const double T = problem.T_ad[at] + load.flux[lane] * problem.response[i];
      const double old = problem.strain[at];
      const double dep = flow_of_vertex(law, load, lane, T, old);
      slip += problem.grid->weight[static_cast<std::size_t>(i)] * dep;
      if (strain_new != nullptr) strain_new[at] = old + dep;
    }
    return slip;
  });
}

void flow_under(const FlowProblem& problem, const FlowLoad& load, int num_rows, const double* threshold, FlowSum& sum) {
  flow<false>(problem, load, num_rows, threshold, nullptr, sum);
}

void flow_to(const FlowProblem& problem, const FlowLoad& load, int num_rows, double* threshold_to_strain,
             FlowSum& sum) {
  flow<true>(problem, load, num_rows, threshold_to_strain, threshold_to_strain, sum);
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(num_rows) * kLanes;
  const std::ptrdiff_t end = static_cast<std::ptrdiff_t>(problem.grid->num_vertices()) * kLanes;
  std::copy(problem.strain + first, problem.strain + end, threshold_to_strain + first);
}

}  // namespace shearbus::physics
