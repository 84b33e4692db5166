// Exponential and logarithm of a register, for kernels of more than one lane. They are shorter than those of
// material/elementary.hpp and have other last bits. A kernel includes this file inside the namespace of its width
// (each_register.hpp); so it has no include guard and no includes.

[[gnu::always_inline]] inline Register larger(Register a, Register b) {
#if SHEARBUS_WIDTH == 4
  return __builtin_ia32_maxpd256(a, b);
#else
  return a > b ? a : b;
#endif
}
[[gnu::always_inline]] inline bool everywhere(Mask mask) {
  return lanes_where(mask) == (1u << kWidth) - 1u;
}

// The parts of 2^x = scale (1 + rest) with an error below 1.2e-15, where x is cut to -kPowers and most. `rest` has this
// error times r^2 / 2 for small r = x ln(2): the polynomial fits (exp(r) - 1 - r) / r^2 for |r| <= ln(2) / 2.
inline constexpr double kLog2E = 1.4426950408889634, kLn2 = 0.6931471805599453;
inline constexpr double kPowers = kExponentialRange * kLog2E;
struct ScaledPower {
  Register scale, rest;
};
[[gnu::always_inline]] inline ScaledPower power_of_2(Register unlimited, double most) {
  constexpr double kShift = 0x1.8p52;
  const Register x = smaller(larger(unlimited, all(-kPowers)), all(most));
  const Register shifted = x + kShift;
  const Register r = (x - (shifted - kShift)) * kLn2;
  const Register r2 = r * r;
  const Register r4 = r2 * r2;
  const Register low = (0.5 + r * 0.1666666666664829) + r2 * (0.04166666666665136 + r * 0.008333333353729397);
  const Register mid =
      (0.0013888888905881542 + r * 0.00019841208732536384) + r2 * (2.4801536388690766e-05 + r * 2.762511557828763e-06);
  return {(Register)(((Bits)shifted << 52) + 0x3ff0000000000000u),
          r + r2 * (low + r4 * (mid + r4 * 2.761380686153829e-07))};
}
[[gnu::always_inline]] inline Register exp2_of(Register x, double most = kPowers) {
  const ScaledPower e = power_of_2(x, most);
  return e.scale + e.scale * e.rest;
}
[[gnu::always_inline]] inline Register exp2_minus_1_of(Register x) {
  const ScaledPower e = power_of_2(x, kPowers);
  return e.scale * e.rest + (e.scale - 1.0);
}

// The binary logarithm of positive normal numbers x = 2^k (1 + f) with an error below 1e-15, absolute or relative. The
// division s = f / (2 + f) is left to the caller: ln(1 + f) = 2 atanh(s), |s| < 0.172; the polynomial fits
// (2 atanh(s) / s - 2) / s^2.
struct SplitLogarithm {
  Register k, f;
  [[gnu::always_inline]] explicit SplitLogarithm(Register x) {
    constexpr std::uint64_t kSqrtHalf = 0x3fe6a09e667f3bcdu, kBias = 1024;  // 1 + f is in sqrt(1/2) to sqrt(2)
    const Bits shifted = (Bits)x + ((kBias << 52) - kSqrtHalf);
    k = (Register)((shifted >> 52) | 0x4330000000000000u) - (0x1p52 + static_cast<double>(kBias));
    f = (Register)((shifted & 0x000fffffffffffffu) + kSqrtHalf) - 1.0;
  }
  [[gnu::always_inline]] Register value(Register s) const {
    const Register z = s * s;
    const Register z2 = z * z;
    const Register low = (kLog2E * 0.6666666666666208 + z * (kLog2E * 0.400000000112122)) +
                         z2 * (kLog2E * 0.2857142413651635 + z * (kLog2E * 0.22222862476849542));
    const Register high = kLog2E * 0.18140185202493248 + z * (kLog2E * 0.166219470901774);
    return k + s * (2.0 * kLog2E + z * (low + z2 * z2 * high));
  }
};

[[gnu::always_inline]] inline Register log2_of(Register x) {
  const SplitLogarithm log(x);
  return log.value(log.f / (2.0 + log.f));
}

[[gnu::always_inline]] inline Register short_exp_of(Register x) {
  return exp2_of(kLog2E * x);
}
[[gnu::always_inline]] inline Register exp_minus_1_of(Register x) {
  return exp2_minus_1_of(kLog2E * x);
}
[[gnu::always_inline]] inline Register short_log_of(Register x) {
  return kLn2 * log2_of(x);
}
// The logarithm of 1 + x for x >= 0, with a small relative error also where 1 + x rounds to 1.
[[gnu::always_inline]] inline Register log_of_1_plus(Register x) {
  const Register sum = 1.0 + x, kept = sum - 1.0;
  const Mask lost = kept <= 0.0;
  return where(lost, x, short_log_of(sum) * (x / where(lost, all(1.0), kept)));
}
