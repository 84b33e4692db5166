#include "server/physics/material/elementary.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace shearbus::physics {
namespace {

// Error of `value` against `exact`, in units in the last place of the exact value.
double ulps(double value, long double exact) {
  const double rounded = static_cast<double>(exact);
  const double ulp = std::nextafter(std::abs(rounded), std::numeric_limits<double>::infinity()) - std::abs(rounded);
  return static_cast<double>(std::abs(static_cast<long double>(value) - exact)) / ulp;
}

TEST(PhysicsElementary, ExponentialIsWithinTwoUlps) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> wide(-700.0, 700.0), narrow(-1.0, 1.0);
  double worst = 0.0, worst_minus_1 = 0.0;
  for (int i = 0; i < 200000; ++i) {
    const double x = i % 2 == 0 ? wide(random) : narrow(random);
    worst = std::max(worst, ulps(exponential(x), std::exp(static_cast<long double>(x))));
    worst_minus_1 = std::max(worst_minus_1, ulps(exponential_minus_1(x), std::expm1(static_cast<long double>(x))));
  }
  EXPECT_LT(worst, 2.0);
  EXPECT_LT(worst_minus_1, 3.0);
  EXPECT_EQ(exponential(0.0), 1.0);
  EXPECT_EQ(exponential_minus_1(0.0), 0.0);
}

TEST(PhysicsElementary, ExponentialStaysFiniteBeyondItsRange) {
  EXPECT_EQ(exponential(1e300), exponential(kExponentialRange));
  EXPECT_EQ(exponential(-1e300), exponential(-kExponentialRange));
  EXPECT_TRUE(std::isfinite(exponential(std::numeric_limits<double>::infinity())));
  EXPECT_GT(exponential(-std::numeric_limits<double>::infinity()), 0.0);
}

TEST(PhysicsElementary, LogarithmIsWithinTwoUlps) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> exponent(-1020.0, 1020.0), near_1(0.5, 2.0);
  double worst = 0.0;
  for (int i = 0; i < 200000; ++i) {
    const double x = i % 2 == 0 ? std::exp2(exponent(random)) : near_1(random);
    worst = std::max(worst, ulps(logarithm(x), std::log(static_cast<long double>(x))));
  }
  EXPECT_LT(worst, 2.0);
  EXPECT_EQ(logarithm(1.0), 0.0);
}

TEST(PhysicsElementary, ErrorFunctionIsWithin1e15) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> wide(0.0, 8.0), narrow(0.0, 0.1);
  double worst = 0.0, worst_slope = 0.0;
  for (int i = 0; i < 200000; ++i) {
    const double x = i % 2 == 0 ? wide(random) : narrow(random);
    const ErrorFunction erf = error_function(x);
    const long double slope = 2.0L / std::sqrt(3.141592653589793238L) * std::exp(-static_cast<long double>(x) * x);
    worst = std::max(worst, static_cast<double>(std::abs(erf.value - std::erf(static_cast<long double>(x)))));
    worst_slope = std::max(worst_slope, static_cast<double>(std::abs(erf.slope - slope)));
  }
  EXPECT_LT(worst, 1e-15);
  EXPECT_LT(worst_slope, 1e-15);
  EXPECT_EQ(error_function(1e300).value, 1.0);
}

TEST(PhysicsElementary, LogarithmOf1PlusKeepsSmallNumbers) {
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> exponent(-300.0, 300.0);
  double worst = 0.0;
  for (int i = 0; i < 200000; ++i) {
    const double x = std::pow(10.0, i % 2 == 0 ? exponent(random) : exponent(random) / 20.0);
    worst = std::max(worst, ulps(log_of_1_plus(x), std::log1p(static_cast<long double>(x))));
  }
  EXPECT_LT(worst, 4.0);
  EXPECT_EQ(log_of_1_plus(0.0), 0.0);
}

}  // namespace
}  // namespace shearbus::physics
