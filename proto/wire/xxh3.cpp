#include "proto/wire/xxh3.hpp"

#define XXH_INLINE_ALL  // compiles xxhash into this file, so that client libraries need no libxxhash
#include <xxhash.h>

namespace shearbus::wire {

#if defined(__x86_64__)
std::uint64_t xxh3_avx2(const void* bytes, std::size_t size, std::uint64_t seed);  // xxh3_avx2.cpp
#endif

std::uint64_t xxh3(std::span<const std::byte> bytes, std::uint64_t seed) {
#if defined(__x86_64__)
  static const bool has_avx2 = __builtin_cpu_supports("avx2") != 0;
  if (has_avx2) return xxh3_avx2(bytes.data(), bytes.size(), seed);
#endif
  return XXH3_64bits_withSeed(bytes.data(), bytes.size(), seed);
}

}  // namespace shearbus::wire
