// Memory of states: on the heap, or mapped from the system if there is much of it.
#pragma once

#include <cstddef>
#include <memory>

namespace shearbus::shard {

struct ReleaseBlock {
  std::size_t mapped_bytes = 0;  // size of a block mapped with mmap; 0: the block is on the heap
  void operator()(double* p) const;
};
using Block = std::unique_ptr<double[], ReleaseBlock>;

// Aligned to 64 bytes; the values are undefined. Throws std::bad_alloc.
Block make_block(std::size_t doubles);

}  // namespace shearbus::shard
