#include "server/physics/solver/layer_flow.hpp"

#include <cstddef>

#include "server/physics/material/strength.hpp"

namespace shearbus::physics {
namespace {

// Logarithms of hardening are cut here: dep is then beyond anything a host imposes, and still a number that sums.
constexpr double kMaxLogHardening = 300.0;

template <bool kWrite>
void flow(const Material& soft, const Grid& grid, const double* response, const FlowLoad& load, const double* T_ad,
          const double* strain, const double* threshold, double* strain_new, FlowSum& sum) {
  const double inverse_n = 1.0 / soft.hardening_exponent;
  const double inverse_beta = 1.0 / soft.hardening_coefficient;
  const double hT = soft.temperature_coefficient;
  const double T_melt = soft.melting_temperature;
  const std::ptrdiff_t n = grid.num_vertices();
  double slip[kLanes] = {};
  double slope[kLanes] = {};
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const std::ptrdiff_t row = i * kLanes;
    const double B = response[i];
    alignas(64) double hardening[kLanes];       // log((sqrt(3) a / (Y0 g))^(1/n)), DLP (48)
    alignas(64) double softening_rate[kLanes];  // -d log g / d log a
    alignas(64) double excess[kLanes];
    for (int l = 0; l < kLanes; ++l) {
      const double heated = load.flux[l] * B;
      const double T = T_ad[row + l] + heated;
      const double to_melting = T_melt - T;
      const double bracket = load.bracket[l] - hT * T;
      const bool solid = to_melting > 0.0 && bracket > 0.0;
      const double safe_to_melting = solid ? to_melting : 1.0;
      const double safe_bracket = solid ? bracket : 1.0;
      const double inverse = 1.0 / (safe_to_melting * safe_bracket);
      const double inverse_to_melting = safe_bracket * inverse;
      const double log_g = logarithm(safe_bracket) - kMeltingFactor * T * inverse_to_melting;
      const double logarithm_cut = inverse_n * (load.log_load[l] - log_g);
      hardening[l] = solid && logarithm_cut < kMaxLogHardening ? logarithm_cut : kMaxLogHardening;
      softening_rate[l] =
          heated * (hT * safe_to_melting * inverse + kMeltingFactor * T_melt * inverse_to_melting * inverse_to_melting);
      excess[l] = hardening[l] - threshold[row + l];
    }
    double largest = excess[0];
    for (int l = 1; l < kLanes; ++l) largest = excess[l] > largest ? excess[l] : largest;
    if (largest > 0.0) {
      const double w = grid.weight[static_cast<std::size_t>(i)];
      for (int l = 0; l < kLanes; ++l) {
        const double hardened = exponential(hardening[l]);
        const double dep = (hardened - 1.0) * inverse_beta - strain[row + l];
        const bool yields = excess[l] > 0.0 && dep > 0.0;
        const double flows = yields ? dep : 0.0;
        const double rate = yields ? hardened * inverse_beta * inverse_n * (1.0 + softening_rate[l]) : 0.0;
        slip[l] += w * flows;
        slope[l] += w * rate;
        if (kWrite) strain_new[row + l] = strain[row + l] + flows;
      }
    } else if (kWrite) {
      for (int l = 0; l < kLanes; ++l) strain_new[row + l] = strain[row + l];
    }
  }
  for (int l = 0; l < kLanes; ++l) {
    sum.slip[l] = slip[l];
    sum.slope[l] = slope[l];
  }
}

}  // namespace

void yield_thresholds(const Material& soft, int num_vertices, const double* strain, double* threshold) {
  const double beta = soft.hardening_coefficient;
  const std::ptrdiff_t values = static_cast<std::ptrdiff_t>(num_vertices) * kLanes;
  for (std::ptrdiff_t i = 0; i < values; ++i) threshold[i] = logarithm(1.0 + beta * strain[i]);
}

void flow_under(const Material& soft, const Grid& grid, const double* response, const FlowLoad& load,
                const double* T_ad, const double* strain, const double* threshold, FlowSum& sum) {
  flow<false>(soft, grid, response, load, T_ad, strain, threshold, nullptr, sum);
}

void flow_to(const Material& soft, const Grid& grid, const double* response, const FlowLoad& load, const double* T_ad,
             const double* strain, double* threshold_to_strain, FlowSum& sum) {
  flow<true>(soft, grid, response, load, T_ad, strain, threshold_to_strain, threshold_to_strain, sum);
}

}  // namespace shearbus::physics
