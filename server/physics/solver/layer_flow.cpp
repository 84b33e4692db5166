#include "server/physics/solver/layer_flow.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "server/physics/material/strength.hpp"

// Lane kernels are compiled twice, the wider version taken where the machine has the registers. Every lane is computed
// by the same products and sums in the same order either way (none fused: contraction is off), so its bits are the
// same; tests/unit/physics_bits.cpp holds them. Sanitizers start too late for functions chosen at load time.
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define SHEARBUS_WIDE [[gnu::target_clones("avx2", "default")]]
#else
#define SHEARBUS_WIDE
#endif

namespace shearbus::physics {
namespace {

// Excesses are cut here: the strain is then beyond anything a host imposes, and still a number that sums.
constexpr double kMaxExcess = 300.0;
constexpr double kMolten = 1e300;  // excess where g = 0: any load flows, kNoLoad does not

// Constants of the material, in registers.
struct FlowLaw {
  explicit FlowLaw(const Material& m)
      : inverse_n(1.0 / m.hardening_exponent),
        inverse_beta(1.0 / m.hardening_coefficient),
        hT(m.temperature_coefficient) {}
  double inverse_n, inverse_beta, hT;
};

// -log(g)/n at a temperature, kMolten where g = 0, and its derivative with respect to T.
struct SofteningExcess {
  double value;
  double rate;
};
inline SofteningExcess softening_excess(const FlowLaw& law, double bracket_at_0, double T_melt, double T) {
  const double to_melting = T_melt - T;
  const double bracket = bracket_at_0 - law.hT * T;
  const bool solid = to_melting > 0.0 && bracket > 0.0;
  const double x = solid ? to_melting : 1.0;
  const double b = solid ? bracket : 1.0;
  const double inverse_xb = 1.0 / (x * b);
  const double inverse_x = b * inverse_xb;
  const double value = law.inverse_n * (kMeltingFactor * T * inverse_x - logarithm(b));
  const double rate = law.inverse_n * (law.hT * x * inverse_xb + kMeltingFactor * T_melt * inverse_x * inverse_x);
  return {solid ? value : kMolten, rate};
}

inline bool any_positive(const double (&value)[kLanes]) {
  double largest = value[0];
  for (int l = 1; l < kLanes; ++l) largest = value[l] > largest ? value[l] : largest;
  return largest > 0.0;
}

enum class Response { kShared, kSpread, kOfTwo };

template <bool kWrite, Response kResponse>
[[gnu::always_inline]] inline void flow(const FlowProblem& problem, const FlowLoad& load, std::ptrdiff_t num_rows,
                                        const double* threshold, double* strain_new, FlowSum& sum) {
  const FlowLaw law(*problem.soft);
  const std::ptrdiff_t heated = problem.num_heated;
  std::ptrdiff_t num_yielding = 0;
  double slip[kLanes] = {};
  double slope[kLanes] = {};
  for (std::ptrdiff_t i = 0; i < num_rows; ++i) {
    const double* strain = problem.strain + i * kLanes;
    const double* yield = threshold + i * kLanes;
    alignas(64) double excess[kLanes];
    alignas(64) double growth[kLanes] = {};  // of -log(g)/n with log(a)
    if (i < heated) {
      constexpr bool kSpread = kResponse == Response::kSpread;
      const double B = kSpread ? 0.0 : problem.response[i];
      const double* B_lane = kSpread ? problem.spread_response + i * kLanes : nullptr;
      const double B_other = kResponse == Response::kOfTwo ? problem.other_response[i] : 0.0;
      const double* T_ad = problem.T_ad + i * kLanes;
      for (int l = 0; l < kLanes; ++l) {
        double rise = load.flux[l] * (kSpread ? B_lane[l] : B);
        if (kResponse == Response::kOfTwo) rise += load.other_flux[l] * B_other;  // one of the two is 0
        const SofteningExcess softened = softening_excess(law, load.bracket[l], load.T_melt[l], T_ad[l] + rise);
        growth[l] = rise * softened.rate;
        excess[l] = (load.scaled_log[l] + softened.value) - yield[l];
      }
    } else {
      for (int l = 0; l < kLanes; ++l) excess[l] = load.scaled_log[l] - yield[l];
    }
    if (any_positive(excess)) {
      num_yielding = i + 1;
      const double w = problem.grid->weight[static_cast<std::size_t>(i)];
      for (int l = 0; l < kLanes; ++l) {
        const double cut = excess[l] < kMaxExcess ? excess[l] : kMaxExcess;
        const double hardened = law.inverse_beta + strain[l];
        const double dep = hardened * exponential_minus_1(cut);
        const bool yields = excess[l] > 0.0;
        const double flows = yields ? dep : 0.0;
        const double rate = yields ? (hardened + dep) * (law.inverse_n + growth[l]) : 0.0;
        slip[l] += w * flows;
        slope[l] += w * rate;
        if (kWrite) strain_new[i * kLanes + l] = strain[l] + flows;
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

}  // namespace

int num_heated_vertices(const Grid& grid, const double* response) {
  // Heating stays below T_melt, so below this share it is lost when added to a temperature.
  constexpr double kLost = 1e-17;
  int n = grid.num_vertices();
  while (n > 1 && response[n - 1] < kLost * response[0]) --n;
  return n;
}

SHEARBUS_WIDE void flow_thresholds(const FlowProblem& problem, const FlowLoad& load, double* threshold) {
  const FlowLaw law(*problem.soft);
  const double beta = problem.soft->hardening_coefficient;
  const std::ptrdiff_t n = problem.grid->num_vertices();
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const double* strain = problem.strain + i * kLanes;
    const double* T_ad = problem.T_ad + i * kLanes;
    double* yield = threshold + i * kLanes;
    for (int l = 0; l < kLanes; ++l) yield[l] = logarithm(1.0 + beta * strain[l]);
    if (i < problem.num_heated) continue;
    for (int l = 0; l < kLanes; ++l) yield[l] -= softening_excess(law, load.bracket[l], load.T_melt[l], T_ad[l]).value;
  }
}

void set_load(const Material& soft, double pressure, double a, double flux, int lane, FlowLoad& load) {
  load.bracket[lane] = 1.0 + soft.pressure_coefficient * pressure + soft.temperature_coefficient * kSofteningReference;
  const double ratio = kSqrt3 * a / soft.yield_strength;
  const bool loads = ratio >= std::numeric_limits<double>::min();
  load.scaled_log[lane] = loads ? logarithm(ratio) / soft.hardening_exponent : kNoLoad;
  load.flux[lane] = flux;
  load.other_flux[lane] = 0.0;
  load.T_melt[lane] = soft.melting_temperature;
}

double flow_of_lane(const FlowProblem& problem, const FlowLoad& load, int lane, double* strain_new) {
  const FlowLaw law(*problem.soft);
  const double beta = problem.soft->hardening_coefficient;
  double slip = 0.0;
  for (std::ptrdiff_t i = 0; i < problem.grid->num_vertices(); ++i) {
    const std::ptrdiff_t at = i * kLanes + lane;
    const double T = problem.T_ad[at] + load.flux[lane] * problem.response[i];
    const double excess =
        (load.scaled_log[lane] + softening_excess(law, load.bracket[lane], load.T_melt[lane], T).value) -
        logarithm(1.0 + beta * problem.strain[at]);
    const double old = problem.strain[at];
    const double dep =
        excess > 0.0 ? (law.inverse_beta + old) * exponential_minus_1(std::min(excess, kMaxExcess)) : 0.0;
    slip += problem.grid->weight[static_cast<std::size_t>(i)] * dep;
    if (strain_new != nullptr) strain_new[at] = old + dep;
  }
  return slip;
}

SHEARBUS_WIDE void flow_under(const FlowProblem& problem, const FlowLoad& load, int num_rows, const double* threshold,
                              FlowSum& sum) {
  if (problem.spread_response != nullptr) {
    flow<false, Response::kSpread>(problem, load, num_rows, threshold, nullptr, sum);
  } else if (problem.other_response != nullptr) {
    flow<false, Response::kOfTwo>(problem, load, num_rows, threshold, nullptr, sum);
  } else {
    flow<false, Response::kShared>(problem, load, num_rows, threshold, nullptr, sum);
  }
}

SHEARBUS_WIDE void flow_to(const FlowProblem& problem, const FlowLoad& load, int num_rows, double* threshold_to_strain,
                           FlowSum& sum) {
  if (problem.spread_response != nullptr) {
    flow<true, Response::kSpread>(problem, load, num_rows, threshold_to_strain, threshold_to_strain, sum);
  } else if (problem.other_response != nullptr) {
    flow<true, Response::kOfTwo>(problem, load, num_rows, threshold_to_strain, threshold_to_strain, sum);
  } else {
    flow<true, Response::kShared>(problem, load, num_rows, threshold_to_strain, threshold_to_strain, sum);
  }
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(num_rows) * kLanes;
  const std::ptrdiff_t end = static_cast<std::ptrdiff_t>(problem.grid->num_vertices()) * kLanes;
  std::copy(problem.strain + first, problem.strain + end, threshold_to_strain + first);
}

}  // namespace shearbus::physics
