/* XXH3-64 compiled for AVX2 (proto/CMakeLists.txt). The file is C: inline functions of C++ headers, compiled for AVX2 here, could
   be linked into code that runs on processors without it. */
#define XXH_INLINE_ALL
#include <stddef.h>
#include <stdint.h>
#include <xxhash.h>

uint64_t shearbus_xxh3_avx2(const void* bytes, size_t size);
uint64_t shearbus_xxh3_avx2(const void* bytes, size_t size) {
  return XXH3_64bits(bytes, size);
}
