#include "server/shard/block.hpp"

#include <sys/mman.h>

#include <new>

namespace shearbus::shard {

namespace {

constexpr std::align_val_t kAlignment{64};
constexpr std::size_t kMappedFrom = std::size_t{128} << 10;  // smallest block that is allocated with mmap  [bytes]

}  // namespace

// Large blocks are mapped with mmap, because munmap returns their memory to the system at once; a heap may keep it.
Block make_block(std::size_t doubles) {
  const std::size_t bytes = doubles * sizeof(double);
  if (bytes < kMappedFrom) return Block(static_cast<double*>(::operator new[](bytes, kAlignment)));
  void* pages = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (pages == MAP_FAILED) throw std::bad_alloc();
  return Block(static_cast<double*>(pages), {.mapped_bytes = bytes});
}

void ReleaseBlock::operator()(double* p) const {
  if (mapped_bytes == 0)
    ::operator delete[](p, kAlignment);
  else
    ::munmap(p, mapped_bytes);
}

}  // namespace shearbus::shard
