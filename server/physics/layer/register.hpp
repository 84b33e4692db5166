// One register of SHEARBUS_WIDTH doubles, its masks, and its elementary functions. The register of the width 1 is a
// double. registers.hpp includes this file for the width 1 and each_register.hpp for the others, each inside a
// namespace; so it has no include guard.

inline constexpr int kWidth = SHEARBUS_WIDTH;
inline constexpr std::uint32_t kAllOfRegister = (1u << kWidth) - 1u;  // its lanes
#if SHEARBUS_WIDTH > 1
using Register [[gnu::vector_size(8 * kWidth)]] = double;
using Bits [[gnu::vector_size(8 * kWidth)]] = std::uint64_t;
#else
using Register = double;
using Bits = std::uint64_t;
#endif
using Mask = decltype(Register{} < Register{});  // all bits of a lane where a comparison holds, else none

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
[[gnu::always_inline]] inline Register larger(Register a, Register b) {
#if SHEARBUS_WIDTH == 4
  return __builtin_ia32_maxpd256(a, b);
#else
  return a > b ? a : b;
#endif
}
[[gnu::always_inline]] inline Bits bits_of(Register a) {
#if SHEARBUS_WIDTH > 1
  return (Bits)a;
#else
  return std::bit_cast<Bits>(a);
#endif
}
[[gnu::always_inline]] inline Register double_of(Bits bits) {
#if SHEARBUS_WIDTH > 1
  return (Register)bits;
#else
  return std::bit_cast<Register>(bits);
#endif
}
[[gnu::always_inline]] inline Register magnitude(Register a) {
  return double_of(bits_of(a) & 0x7fffffffffffffffu);
}
// The lanes that are not in the mask.
[[gnu::always_inline]] inline Mask without(Mask mask) {
#if SHEARBUS_WIDTH > 1
  return ~mask;
#else
  return !mask;
#endif
}
// `a` where the mask is set, else 0.
[[gnu::always_inline]] inline Register only(Mask mask, Register a) {
#if SHEARBUS_WIDTH > 1
  return double_of((Bits)mask & bits_of(a));
#else
  return mask ? a : 0.0;
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

[[gnu::always_inline]] inline bool everywhere(Mask mask) {
  return lanes_where(mask) == kAllOfRegister;
}
[[gnu::always_inline]] inline bool anywhere(Mask mask) {
  return lanes_where(mask) != 0;
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
#endif

#include "server/physics/layer/elementary.hpp"
