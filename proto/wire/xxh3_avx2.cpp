// XXH3-64 compiled for AVX2 (proto/CMakeLists.txt). This file includes no header of C++: an inline function of such a
// header, compiled for AVX2 here, could be linked into code that runs on processors without AVX2.
#define XXH_INLINE_ALL
#include <stddef.h>
#include <stdint.h>
#include <xxhash.h>

extern "C" uint64_t shearbus_xxh3_avx2(const void* bytes, size_t size);
extern "C" uint64_t shearbus_xxh3_avx2(const void* bytes, size_t size) {
  return XXH3_64bits(bytes, size);
}
