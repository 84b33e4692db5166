// exp, log and erf of the doubles of a register, or of one double. All are plain products and sums in a fixed order, so
// that their bits depend neither on the machine nor on the lane. exp and log err by less than 2 units in the last
// place, erf by less than 1e-15 (tests/unit/physics_elementary.cpp). register.hpp includes this file once per width; so
// it has no include guard and no includes.

inline constexpr double kLn2 = 0.6931471805599453;
inline constexpr double kLog2E = 1.4426950408889634;

// The two parts of an exponential: exp(x) = scale (1 + rest).
struct Exponential {
  Register scale;  // a power of 2
  Register rest;
  // exp(x) for |x| <= kExponentialRange.
  [[gnu::always_inline]] explicit Exponential(Register x) {
    constexpr double kLn2High = 0x1.62e42feep-1;  // leading digits of ln(2): k * kLn2High is exact for integers k
    constexpr double kLn2Low = 0x1.a39ef35793c76p-33;
    const Register shifted = x * kLog2E + kShift;
    const Register k = shifted - kShift;
    set(shifted, (x - k * kLn2High) - k * kLn2Low);
  }
  // 2^x for |x| <= kExponentialRange / ln(2), which needs fewer products.
  [[gnu::always_inline]] static Exponential of_2(Register x) {
    Exponential e;
    const Register shifted = x + kShift;
    e.set(shifted, (x - (shifted - kShift)) * kLn2);
    return e;
  }
  [[gnu::always_inline]] Register value() const { return scale + scale * rest; }
  [[gnu::always_inline]] Register minus_1() const { return scale * rest + (scale - 1.0); }

 private:
  static constexpr double kShift = 0x1.8p52;  // adding it to x rounds x to an integer, in the low bits of the sum

  Exponential() = default;
  // exp(k ln(2) + r) for the integer k in the low bits of `shifted` and |r| <= ln(2)/2. The polynomial fits
  // (exp(r) - 1 - r) / r^2; its groups of four overlap in the processor.
  [[gnu::always_inline]] void set(Register shifted, Register r) {
    const Register r2 = r * r;
    const Register r4 = r2 * r2;
    const Register low =
        (0.5000000000000012 + r * 0.166666666666667) + r2 * (0.04166666666651555 + r * 0.008333333333307052);
    const Register mid = (0.0013888888946991008 + r * 0.00019841269917714825) +
                         r2 * (2.4801489960613868e-05 + r * 2.7557216015971066e-06);
    const Register high = 2.7631275870530614e-07 + r * 2.511794666085131e-08;
    scale = double_of((bits_of(shifted) << 52) + 0x3ff0000000000000u);
    rest = r + r2 * (low + r4 * (mid + r4 * high));
  }
};

// The functions exp(x), 2^x and exp(x) - 1, with x cut to -kExponentialRange and `most`.
[[gnu::always_inline]] inline Register exp_of(Register x, double most = kExponentialRange) {
  return Exponential(smaller(all(most), larger(all(-kExponentialRange), x))).value();
}
[[gnu::always_inline]] inline Register exp2_of(Register x, double most) {
  return Exponential::of_2(smaller(all(most), larger(all(-kExponentialRange), x))).value();
}
[[gnu::always_inline]] inline Register exp_minus_1_of(Register x) {
  return Exponential(smaller(all(kExponentialRange), larger(all(-kExponentialRange), x))).minus_1();
}

// The natural logarithm of a positive normal number x = 2^k (1 + f), with 1 + f from sqrt(1/2) to sqrt(2). The quotient
// s = f / (2 + f) is left to callers who divide anyway: log(1 + f) = 2 atanh(s), |s| < 0.172.
struct SplitLogarithm {
  Register k, f;
  [[gnu::always_inline]] explicit SplitLogarithm(Register x) {
    constexpr std::uint64_t kSqrtHalf = 0x3fe6a09e667f3bcdu, kBias = 1024;
    const Bits shifted = bits_of(x) + ((kBias << 52) - kSqrtHalf);
    k = double_of((shifted >> 52) | 0x4330000000000000u) - (0x1p52 + static_cast<double>(kBias));
    f = double_of((shifted & 0x000fffffffffffffu) + kSqrtHalf) - 1.0;
  }
  // 2 atanh(s) is f - s (f - tail); the polynomial of `tail` fits (2 atanh(s) / s - 2) / s^2.
  [[gnu::always_inline]] Register value(Register s) const {
    const Register z = s * s;
    const Register z2 = z * z;
    const Register low =
        (0.6666666666666734 + z * 0.3999999999941455) + z2 * (0.2857142874243227 + z * 0.22222198567329124);
    const Register high = (0.1818356468664556 + z * 0.15314040058819647) + z2 * 0.14796066193735952;
    const Register tail = z * (low + (z2 * z2) * high);
    return k * kLn2 + (f - s * (f - tail));
  }
};
[[gnu::always_inline]] inline Register log_of(Register x) {
  const SplitLogarithm log(x);
  return log.value(log.f / (2.0 + log.f));
}

// The logarithm log(1 + x) of x >= 0, with a small relative error also where 1 + x rounds to 1.
[[gnu::always_inline]] inline Register log_of_1_plus(Register x) {
  const Register sum = 1.0 + x;
  const Register kept = sum - 1.0;  // the part of x that survives the rounding of 1 + x
  const Mask lost = without(kept > 0.0);
  return where(lost, x, log_of(sum) * (x / where(lost, all(1.0), kept)));
}

// The power x^y of a positive normal x.
[[gnu::always_inline]] inline Register power_of(Register x, Register y) {
  return exp_of(y * log_of(x));
}

// The error function of x >= 0 and its derivative: erf = 1 - exp(-x^2) q(x) / (1 + 2 x), where q(x) = (1 + 2 x)
// exp(x^2) erfc(x) varies little. q is a Chebyshev series of degree 18 in u = (11 x / 6 - 5/2) / (x + 5/2), which maps
// [0, 6] to [-1, 1]; computed to 34 digits, written in powers of u, and grouped so that products overlap.
struct ErrorFunction {
  Register value, slope;
};
[[gnu::always_inline]] inline ErrorFunction error_function(Register x) {
  constexpr double kErrorIsOne = 6.0;  // from this x on erf(x) counts as 1: 1 - erf(6) = 2e-17
  constexpr double kTwoOverSqrtPi = 1.1283791670955126;
  const Register within = smaller(x, all(kErrorIsOne));
  const Register u = (11.0 / 6.0 * within - 2.5) / (within + 2.5);
  const Register u2 = u * u;
  const Register u4 = u2 * u2;
  const Register u8 = u4 * u4;
  const Register four_0 =
      (1.2874076321735601 + u * -0.0081369785904441237) + u2 * (-0.14926996452895938 + u * 0.10743648309461562);
  const Register four_4 =
      (-0.036236927366877725 + u * 0.0040424796421399149) + u2 * (0.0012083274473638687 + u * -0.00031171182763887751);
  const Register four_8 = (-6.6654265842322225e-05 + u * 1.8154509766604585e-05) +
                          u2 * (5.7685132209709903e-06 + u * -7.1770012423750375e-07);
  const Register four_12 = (-5.2793856041847109e-07 + u * -2.7038440205867369e-08) +
                           u2 * (3.7998474511703217e-08 + u * 9.4679192304587041e-09);
  const Register last = (-1.264515299927642e-09 + u * -8.5429485427471322e-10) + u2 * -6.4365131973788702e-11;
  const Register q = (four_0 + u4 * four_4) + u8 * ((four_8 + u4 * four_12) + u8 * last);
  const Register bell = exp_of(-within * within);
  return {where(x < kErrorIsOne, 1.0 - bell * q / (1.0 + 2.0 * within), all(1.0)), kTwoOverSqrtPi * bell};
}
