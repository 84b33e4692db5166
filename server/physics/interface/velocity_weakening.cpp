#include "server/physics/interface/velocity_weakening.hpp"

#include <algorithm>
#include <cmath>

#include "server/physics/material/elementary.hpp"

namespace shearbus::physics {
namespace {

constexpr int kMaxIterations = 200;  // largest number of iterations of zero_between(); bisection needs about 60
constexpr double kArrived = 1e-15;   // the iteration ends at a step below this share of the bracket's upper end

// The balance h(a) = mu(c - b a) P - a of a step, as a function of the stress a.
struct Balance {
  const VelocityWeakening& law;
  double pressure, c, b;

  double value(double a) const { return law.coefficient(c - b * a) * pressure - a; }
  double slope(double a) const { return (law.coefficient(c - b * a) - law.fast) * law.decay * b * pressure - 1.0; }
  double end_of_slip() const { return c / b; }
  // The stress a at which the balance h is smallest. Inside (0, c/b) h has a minimum only if friction falls with
  // velocity; the minimum lies where b theta (mu_0 - mu_inf) P exp(-theta v) = 1.
  double turn() const {
    const double steepness = (law.at_rest - law.fast) * pressure * law.decay * b;
    if (!(steepness > 0.0)) return end_of_slip();
    return std::clamp((c - logarithm(steepness) / law.decay) / b, 0.0, end_of_slip());
  }
};

// Finds the only zero of h in [left, right] by Newton steps from `a` and by bisection. `rising`: h rises at the zero.
double zero_between(const Balance& h, double left, double right, double a, bool rising) {
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const double value = h.value(a);
    ((value > 0.0) == rising ? right : left) = a;
    double next = a - value / h.slope(a);
    if (!(next > left && next < right)) next = 0.5 * (left + right);
    if (std::abs(next - a) <= kArrived * right || right - left <= kArrived * right) return next;
    a = next;
  }
  return a;
}

}  // namespace

double VelocityWeakening::coefficient(double velocity) const {
  return fast + (at_rest - fast) * exponential(-decay * std::max(0.0, velocity));
}

double sliding_stress(const VelocityWeakening& law, double pressure, double c, double b) {
  const double at_rest = law.at_rest * pressure;
  if (c <= 0.0) return at_rest;
  const Balance h{law, pressure, c, b};
  const double turn = h.turn();
  if (h.value(turn) > 0.0) return at_rest;  // the balance has no zero while the interface slips
  return zero_between(h, 0.0, turn, 0.0, false);
}

InterfaceOptions VelocityWeakening::typical(const InterfaceOptions& options, const Material& /*soft*/) {
  InterfaceOptions typical = options;
  typical.friction_coefficient_fast = 0.1 * options.friction_coefficient;
  typical.velocity_decay = 0.01;
  return typical;
}

FrictionValue VelocityWeakening::at(const InterfaceOptions& options, const Material& /*soft*/, double /*T0*/,
                                    double slip) {
  const VelocityWeakening law = of(options);
  const double mu = law.coefficient(slip);
  return {mu, 0.0, -law.decay * (mu - law.fast)};
}

SlidingFriction VelocityWeakening::of_step(const InterfaceOptions& options, double pressure, double c, double b,
                                           double a_stick) {
  const VelocityWeakening law = of(options);
  SlidingFriction friction{sliding_stress(law, pressure, c, b), law.coefficient(c - b * a_stick) * pressure};
  if (c <= 0.0) return friction;
  const Balance h{law, pressure, c, b};
  const double end = h.end_of_slip();
  const double turn = h.turn();
  if (friction.sliding <= turn && turn < end && h.value(end) > 0.0) {
    friction.exceeds_again = zero_between(h, turn, end, end, true);
  }
  return friction;
}

}  // namespace shearbus::physics
