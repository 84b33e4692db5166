// XXH3-64 compiled for AVX2 (proto/CMakeLists.txt). This file includes no header of C++: an inline function of such a
// header, compiled for AVX2 here, could be linked into code that runs on processors without AVX2.
#define XXH_INLINE_ALL
#include <stddef.h>
#include <stdint.h>
#include <xxhash.h>

namespace shearbus::wire {

uint64_t xxh3_avx2(const void* bytes, size_t size, uint64_t seed);
uint64_t xxh3_avx2(const void* bytes, size_t size, uint64_t seed) {
  return XXH3_64bits_withSeed(bytes, size, seed);
}

}  // namespace shearbus::wire
