// exp, log and erf with bits that do not depend on the machine, the library or the lane: plain products and sums in a
// fixed order. The C library picks variants with fused multiply-add where the processor has them, which changes last
// bits from host to host. All functions are inlined into loops over lanes and vectorise. The error of exp and log is
// below 2 units in the last place, the error of erf below 1e-15 (tests/unit/physics_elementary.cpp).
#pragma once

#include <bit>
#include <cstdint>

namespace shearbus::physics {

inline constexpr double kExponentialRange = 700.0;  // largest |x| that enters exp(x), so that exp(x) is a normal number

namespace detail {

// The two parts of an exponential: exp(x) = scale (1 + rest), |x| <= kExponentialRange.
struct ScaledExponential {
  double scale;  // a power of 2
  double rest;
};
inline ScaledExponential scaled_exponential(double x) {
  constexpr double kShift = 0x1.8p52;  // adding kShift to x rounds x to an integer, in the low bits of the sum
  constexpr double kLog2E = 1.4426950408889634;
  constexpr double kLn2High = 0x1.62e42feep-1;  // leading digits of ln(2): k * kLn2High is exact for integers k
  constexpr double kLn2Low = 0x1.a39ef35793c76p-33;
  const double shifted = x * kLog2E + kShift;
  const double k = shifted - kShift;
  const double r = (x - k * kLn2High) - k * kLn2Low;  // remainder r of x = k ln(2) + r, |r| <= ln(2)/2
  // The Taylor series of exp(r) - 1 to r^13, grouped so that the processor can overlap the products.
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

// The functions exp(x) and exp(x) - 1, with x clamped to +-kExponentialRange.
inline double exponential(double x) {
  const detail::ScaledExponential e = detail::scaled_exponential(detail::within_range(x));
  return e.scale * (1.0 + e.rest);
}
inline double exponential_minus_1(double x) {
  const detail::ScaledExponential e = detail::scaled_exponential(detail::within_range(x));
  return e.scale * e.rest + (e.scale - 1.0);
}

// The natural logarithm of a positive normal number.
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
  // log(1+f) = 2 atanh(s) with s = f/(2+f), |s| < 0.172; f - (f^2/2 - ...) keeps the leading term exact.
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

// The logarithm log(1 + x) of x >= 0, with a small relative error also where 1 + x rounds to 1.
inline double logarithm_of_1_plus(double x) {
  const double sum = 1.0 + x;
  const double kept = sum - 1.0;  // the part of x that survives the rounding of 1 + x
  const bool lost = !(kept > 0.0);
  return lost ? x : logarithm(sum) * (x / (lost ? 1.0 : kept));
}

// The power x^y of a positive normal x.
inline double power(double x, double y) {
  return exponential(y * logarithm(x));
}

// The error function of x >= 0 and its derivative, with absolute errors of 1e-15: erf = 1 - exp(-x^2) q(x) / (1 + 2 x),
// where q(x) = (1 + 2 x) exp(x^2) erfc(x) varies little. q is a Chebyshev series of degree 18 in
// u = (11 x / 6 - 5/2) / (x + 5/2), which maps [0, 6] to [-1, 1]; computed to 34 digits, written in powers of u.
inline constexpr double kErrorIsOne = 6.0;  // from this x on erf(x) counts as 1: 1 - erf(6) = 2e-17
inline constexpr double kTwoOverSqrtPi = 1.1283791670955126;
inline constexpr double kErrorSeries[] = {
    1.2874076321735601,      -0.0081369785904441237,  -0.14926996452895938,   0.10743648309461562,
    -0.036236927366877725,   0.0040424796421399149,   0.0012083274473638687,  -0.00031171182763887751,
    -6.6654265842322225e-05, 1.8154509766604585e-05,  5.7685132209709903e-06, -7.1770012423750375e-07,
    -5.2793856041847109e-07, -2.7038440205867369e-08, 3.7998474511703217e-08, 9.4679192304587041e-09,
    -1.264515299927642e-09,  -8.5429485427471322e-10, -6.4365131973788702e-11};
struct ErrorFunction {
  double value;
  double slope;
};
inline ErrorFunction error_function(double x) {
  const bool is_one = !(x < kErrorIsOne);
  const double within = is_one ? kErrorIsOne : x;
  const double u = (11.0 / 6.0 * within - 2.5) / (within + 2.5);
  // The polynomial q(u), grouped by powers of u^4: products can overlap, and loops over lanes that call error_function
  // have no inner loop.
  const double u2 = u * u;
  const double u4 = u2 * u2;
  const double u8 = u4 * u4;
  const auto four = [&](int i) {
    return (kErrorSeries[i] + u * kErrorSeries[i + 1]) + u2 * (kErrorSeries[i + 2] + u * kErrorSeries[i + 3]);
  };
  const double high =
      (four(8) + u4 * four(12)) + u8 * ((kErrorSeries[16] + u * kErrorSeries[17]) + u2 * kErrorSeries[18]);
  const double q = (four(0) + u4 * four(4)) + u8 * high;
  const double bell = exponential(-within * within);
  return {is_one ? 1.0 : 1.0 - bell * q / (1.0 + 2.0 * within), kTwoOverSqrtPi * bell};
}

}  // namespace shearbus::physics
