// exp and log whose bits do not depend on the machine, the library or the lane: plain products and sums in a fixed
// order. The C library picks variants with fused multiply-add where the processor has them, which changes last bits
// from host to host. Both inline into lane loops and vectorise. Error below 2 units in the last place
// (tests/unit/physics_elementary.cpp).
#pragma once

#include <bit>
#include <cstdint>

namespace shearbus::physics {

inline constexpr double kExponentialRange = 700.0;  // |x| beyond this is taken as this: results stay normal numbers

namespace detail {

// exp(x) = scale (1 + rest), |x| <= kExponentialRange.
struct ScaledExponential {
  double scale;  // a power of 2
  double rest;
};
inline ScaledExponential scaled_exponential(double x) {
  constexpr double kShift = 0x1.8p52;  // adding it rounds to an integer, which then stands in the low bits
  constexpr double kLog2E = 1.4426950408889634;
  constexpr double kLn2High = 0x1.62e42feep-1;  // few enough digits that k * kLn2High is exact
  constexpr double kLn2Low = 0x1.a39ef35793c76p-33;
  const double shifted = x * kLog2E + kShift;
  const double k = shifted - kShift;
  const double r = (x - k * kLn2High) - k * kLn2Low;  // |r| <= ln(2)/2
  // Taylor series to r^13, grouped so that products can overlap.
  const double r2 = r * r;
  const double r4 = r2 * r2;
  const double low = (1.0 / 2 + r * (1.0 / 6)) + r2 * (1.0 / 24 + r * (1.0 / 120));
  const double mid = (1.0 / 720 + r * (1.0 / 5040)) + r2 * (1.0 / 40320 + r * (1.0 / 362880));
  const double high = (1.0 / 3628800 + r * (1.0 / 39916800)) + r2 * (1.0 / 479001600 + r * (1.0 / 6227020800.0));
  const std::uint64_t scale = (std::bit_cast<std::uint64_t>(shifted) << 52) + 0x3ff0000000000000u;
  return {std::bit_cast<double>(scale), r + r2 * (low + r4 * (mid + r4 * high))};
}

inline double within_range(double x) {
  x = x < -kExponentialRange ? -kExponentialRange : x;
  return x > kExponentialRange ? kExponentialRange : x;
}

}  // namespace detail

// exp(x) and exp(x) - 1, x clamped to +-kExponentialRange.
inline double exponential(double x) {
  const detail::ScaledExponential e = detail::scaled_exponential(detail::within_range(x));
  return e.scale * (1.0 + e.rest);
}
inline double exponential_minus_1(double x) {
  const detail::ScaledExponential e = detail::scaled_exponential(detail::within_range(x));
  return e.scale * e.rest + (e.scale - 1.0);
}

// log(x) of a positive normal number.
inline double logarithm(double x) {
  constexpr double kInteger = 0x1p52;
  constexpr double kLn2High = 0x1.62e42feep-1;
  constexpr double kLn2Low = 0x1.a39ef35793c76p-33;
  constexpr double kSqrt2 = 1.4142135623730951;
  const std::uint64_t bits = std::bit_cast<std::uint64_t>(x);
  const double biased = std::bit_cast<double>((bits >> 52) | 0x4330000000000000u) - kInteger;
  const double significand = std::bit_cast<double>((bits & 0x000fffffffffffffu) | 0x3ff0000000000000u);
  const bool large = significand > kSqrt2;
  const double f = (large ? 0.5 * significand : significand) - 1.0;
  const double k = biased - (large ? 1022.0 : 1023.0);
  // log(1+f) = 2 atanh(s) with s = f/(2+f), |s| < 0.172; f - s (f - ...) keeps the leading term exact.
  const double s = f / (2.0 + f);
  const double z = s * s;
  const double z2 = z * z;
  const double z4 = z2 * z2;
  const double low = (2.0 / 3 + z * (2.0 / 5)) + z2 * (2.0 / 7 + z * (2.0 / 9));
  const double mid = (2.0 / 11 + z * (2.0 / 13)) + z2 * (2.0 / 15 + z * (2.0 / 17));
  const double high = (2.0 / 19 + z * (2.0 / 21)) + z2 * (2.0 / 23);
  const double tail = z * (low + z4 * (mid + z4 * high));
  const double half_square = 0.5 * f * f;
  return k * kLn2High - ((half_square - (s * (half_square + tail) + k * kLn2Low)) - f);
}

// x^y of a positive normal x.
inline double power(double x, double y) {
  return exponential(y * logarithm(x));
}

}  // namespace shearbus::physics
