// Two elastic half-spaces that slide on each other under an interface law that softens with the interface temperature
// (tests/measured.toml, "Exact solutions"), written as one Volterra equation and solved to high accuracy. The
// solution shares no code with the layer, the hydrocode or the bus.
#pragma once

#include <cmath>
#include <vector>

namespace shearbus::test {

struct HalfSpaces {
  double initial_jump;          // velocity jump before the contact, V0  [m/s]
  double pressure;              // compression of the contact [Pa]
  double friction_coefficient;  // friction coefficient mu of Coulomb friction
  double yield_strength;        // yield strength of the interface  [Pa]
  double initial_temperature = 300.0;
  // The other constants of the two bodies: aluminium on steel of the DLP paper, in SI units.
  double density_soft = 2703.0, density_hard = 7900.0;
  double modulus_soft = 27.6e9, modulus_hard = 77e9;
  double conductivity_soft = 117.0, conductivity_hard = 16.1;
  double diffusivity_soft = 48.9e-6, diffusivity_hard = 4.076e-6;
  double pressure_coefficient = 6.52e-11, temperature_coefficient = 6.16e-4, melting_temperature = 1220.0;

  double limit(double temperature) const {
    if (temperature >= melting_temperature) return 0.0;
    const double bracket = 1.0 + pressure_coefficient * pressure - temperature_coefficient * (temperature - 300.0);
    const double g = std::max(0.0, bracket) * std::exp(-0.001 * temperature / (melting_temperature - temperature));
    return std::min(friction_coefficient * pressure, yield_strength * g / std::sqrt(3.0));
  }
  // Returns the velocity jump under a shear stress s of the interface, V0 - s (1/Z_soft + 1/Z_hard), where V0 is the
  // initial jump and Z the shear impedance of a body.
  double jump(double stress) const {
    return initial_jump -
           stress * (1.0 / std::sqrt(density_soft * modulus_soft) + 1.0 / std::sqrt(density_hard * modulus_hard));
  }
  double heat_partition() const {
    const double soft = conductivity_soft * std::sqrt(diffusivity_hard);
    return soft / (soft + conductivity_hard * std::sqrt(diffusivity_soft));
  }
};

struct HalfSpaceState {
  double time, stress, jump, temperature;
};

// Returns the solution at `intervals` + 1 times from 0 to `end`. The times are graded quadratically because the
// solution is smooth in sqrt(t). The method is product integration: the friction power is linear in each interval, and
// the kernel (t - x)^(-1/2) is integrated exactly, so that the error decreases as intervals^-2. `jump_at(last, time,
// stress)` is the velocity jump at a time under a stress, after the state before.
template <class JumpAt>
std::vector<HalfSpaceState> solve_sliding(const HalfSpaces& problem, double end, int intervals, const JumpAt& jump_at) {
  const double pi = std::acos(-1.0);
  const double factor = problem.heat_partition() / problem.conductivity_soft * std::sqrt(problem.diffusivity_soft / pi);
  const double start = problem.initial_temperature, at_rest = problem.limit(start);
  HalfSpaceState last{0.0, at_rest, problem.initial_jump, start};
  last.jump = jump_at(last, 0.0, at_rest);
  std::vector<HalfSpaceState> states = {last};
  for (int i = 1; i <= intervals; ++i) {
    const double share = static_cast<double>(i) / intervals;
    const double now = end * share * share;
    double known = start;
    double weight_of_last = 0.0;
    for (std::size_t j = 0; j < states.size(); ++j) {
      const bool newest = j + 1 == states.size();
      const double a = now - states[j].time;
      const double b = newest ? 0.0 : now - states[j + 1].time;
      const double whole = 2.0 * (std::sqrt(a) - std::sqrt(b));
      const double rising = (a * whole - 2.0 / 3.0 * (a * std::sqrt(a) - b * std::sqrt(b))) / (a - b);
      known += factor * (whole - rising) * states[j].stress * states[j].jump;
      if (!newest) known += factor * rising * states[j + 1].stress * states[j + 1].jump;
      weight_of_last = factor * rising;
    }
    const auto state_at = [&](double temperature) {
      const double stress = problem.limit(temperature);
      return HalfSpaceState{now, stress, jump_at(states.back(), now, stress), temperature};
    };
    double low = start;
    double high = problem.melting_temperature;
    for (int bisection = 0; bisection < 60; ++bisection) {
      const double middle = 0.5 * (low + high);
      const HalfSpaceState state = state_at(middle);
      (known + weight_of_last * state.stress * state.jump > middle ? low : high) = middle;
    }
    states.push_back(state_at(0.5 * (low + high)));
  }
  return states;
}

inline std::vector<HalfSpaceState> solve_two_half_spaces(const HalfSpaces& problem, double end, int intervals) {
  return solve_sliding(problem, end, intervals,
                       [&](const HalfSpaceState&, double, double stress) { return problem.jump(stress); });
}

// Returns the solution for two free plates whose relative motion friction brakes: d[V]/dt = -mobility * s with mobility
// = 1/m_soft + 1/m_hard, where m is the mass of a plate per area. The integral of the momentum is computed by the
// trapezoidal rule.
inline std::vector<HalfSpaceState> solve_braked_plates(const HalfSpaces& problem, double mobility, double end,
                                                       int intervals) {
  return solve_sliding(problem, end, intervals, [&](const HalfSpaceState& last, double now, double stress) {
    return last.jump - 0.5 * (now - last.time) * mobility * (last.stress + stress);
  });
}

}  // namespace shearbus::test
