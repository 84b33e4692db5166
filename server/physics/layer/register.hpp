// One register of SHEARBUS_WIDTH doubles, its masks, and a row: the values of all lanes of a tile in such registers.
// each_register.hpp includes this file once per width, inside a namespace; so it has no include guard and no includes.

inline constexpr int kWidth = SHEARBUS_WIDTH;
#if SHEARBUS_WIDTH > 1
inline constexpr int kParts = kLanes / kWidth;  // number of registers of a row
using Register [[gnu::vector_size(8 * kWidth)]] = double;
using Bits [[gnu::vector_size(8 * kWidth)]] = std::uint64_t;
#else
inline constexpr int kParts = 1;  // a row of one lane; pointers to rows point to this lane
using Register = double;
#endif
using Mask = decltype(Register{} < Register{});  // all bits of a lane where a comparison holds, else none

#define SHEARBUS_EACH_PART _Pragma("GCC unroll 4") for (std::ptrdiff_t p = 0; p < kParts; ++p)

[[gnu::always_inline]] inline Register load(const double* lanes) {
  Register r;
  __builtin_memcpy(&r, lanes, sizeof r);
  return r;
}
[[gnu::always_inline]] inline void store(Register r, double* lanes) {
  __builtin_memcpy(lanes, &r, sizeof r);
}
[[gnu::always_inline]] inline Register all(double value) {
  return value - Register{};
}
// The value `yes` where the mask is set, else `no`.
[[gnu::always_inline]] inline Register where(Mask mask, Register yes, Register no) {
#if SHEARBUS_WIDTH == 4
  return __builtin_ia32_blendvpd256(no, yes, (Register)mask);
#elif SHEARBUS_WIDTH == 2
  return (Register)(((Bits)mask & (Bits)yes) | (~(Bits)mask & (Bits)no));
#else
  return mask ? yes : no;
#endif
}
[[gnu::always_inline]] inline Register smaller(Register a, Register b) {
  return a < b ? a : b;
}
[[gnu::always_inline]] inline Register magnitude(Register a) {
#if SHEARBUS_WIDTH > 1
  return (Register)((Bits)a & 0x7fffffffffffffffu);
#else
  return std::abs(a);
#endif
}
// The lanes that are not in the mask.
[[gnu::always_inline]] inline Mask without(Mask mask) {
#if SHEARBUS_WIDTH > 1
  return ~mask;
#else
  return !mask;
#endif
}
// One bit per lane.
[[gnu::always_inline]] inline std::uint32_t lanes_where(Mask mask) {
#if SHEARBUS_WIDTH == 1
  return mask ? 1 : 0;
#elif defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#if SHEARBUS_WIDTH == 4
  return static_cast<std::uint32_t>(__builtin_ia32_movmskpd256((Register)mask));
#else
  return static_cast<std::uint32_t>(__builtin_ia32_movmskpd((Register)mask));
#endif
#else
  std::uint32_t lanes = 0;
  for (int l = 0; l < kWidth; ++l) lanes |= mask[l] != 0 ? 1u << l : 0u;
  return lanes;
#endif
}

#if SHEARBUS_WIDTH > 1
// The mask of the lanes whose bits are set in `lanes`, from bit 0 on.
[[gnu::always_inline]] inline Mask mask_of(std::uint32_t lanes) {
#if SHEARBUS_WIDTH == 4
  constexpr Bits kBit = {1, 2, 4, 8};
#else
  constexpr Bits kBit = {1, 2};
#endif
  return ((Bits{} + lanes) & kBit) != 0;
}

// The natural logarithm of positive normal numbers, with the bits of logarithm() (material/elementary.hpp).
[[gnu::always_inline]] inline Register log_of(Register x) {
  constexpr double kLn2High = 0x1.62e42feep-1;
  constexpr double kLn2Low = 0x1.a39ef35793c76p-33;
  const Bits bits = (Bits)x;
  const Register biased = (Register)((bits >> 52) | 0x4330000000000000u) - 0x1p52;
  const Register significand = (Register)((bits & 0x000fffffffffffffu) | 0x3ff0000000000000u);
  const Mask large = significand > 1.4142135623730951;
  const Register f = where(large, 0.5 * significand, significand) - 1.0;
  const Register k = biased - where(large, all(1022.0), all(1023.0));
  const Register s = f / (2.0 + f);
  const Register z = s * s;
  const Register z2 = z * z;
  const Register z4 = z2 * z2;
  const Register low = (2.0 / 3 + z * (2.0 / 5)) + z2 * (2.0 / 7 + z * (2.0 / 9));
  const Register mid = (2.0 / 11 + z * (2.0 / 13)) + z2 * (2.0 / 15 + z * (2.0 / 17));
  const Register high = (2.0 / 19 + z * (2.0 / 21)) + z2 * (2.0 / 23);
  const Register tail = z * (low + z4 * (mid + z4 * high));
  const Register half_square = 0.5 * f * f;
  return k * kLn2High - ((half_square - (s * (half_square + tail) + k * kLn2Low)) - f);
}

// exp(x) = scale (1 + rest) for |x| <= kExponentialRange, with the bits of scaled_exponential() (material/elementary.hpp).
struct Exponential {
  Register scale, rest;
  [[gnu::always_inline]] explicit Exponential(Register x) {
    constexpr double kShift = 0x1.8p52, kLog2E = 1.4426950408889634;
    constexpr double kLn2High = 0x1.62e42feep-1, kLn2Low = 0x1.a39ef35793c76p-33;
    const Register shifted = x * kLog2E + kShift;
    const Register k = shifted - kShift;
    const Register r = (x - k * kLn2High) - k * kLn2Low;
    const Register r2 = r * r;
    const Register r4 = r2 * r2;
    const Register low = (1.0 / 2 + r * (1.0 / 6)) + r2 * (1.0 / 24 + r * (1.0 / 120));
    const Register mid = (1.0 / 720 + r * (1.0 / 5040)) + r2 * (1.0 / 40320 + r * (1.0 / 362880));
    const Register high = (1.0 / 3628800 + r * (1.0 / 39916800)) + r2 * (1.0 / 479001600 + r * (1.0 / 6227020800.0));
    scale = (Register)(((Bits)shifted << 52) + 0x3ff0000000000000u);
    rest = r + r2 * (low + r4 * (mid + r4 * high));
  }
  [[gnu::always_inline]] Register value() const { return scale * (1.0 + rest); }
  [[gnu::always_inline]] Register minus_1() const { return scale * rest + (scale - 1.0); }
};

// The exponential, with the bits of exponential() (material/elementary.hpp).
[[gnu::always_inline]] inline Register exp_of(Register x) {
  const Register within = smaller(where(x < -kExponentialRange, all(-kExponentialRange), x), all(kExponentialRange));
  return Exponential(within).value();
}
#else
[[gnu::always_inline]] inline double log_of(double x) {
  return logarithm(x);
}
[[gnu::always_inline]] inline double exp_of(double x) {
  return exponential(x);
}
#endif
// The power x^y of positive normal numbers x, with the bits of power().
[[gnu::always_inline]] inline Register power_of(Register x, Register y) {
  return exp_of(y * log_of(x));
}
