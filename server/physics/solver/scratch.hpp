// Scratch states of one tile, owned by the calling thread. A step allocates only these, once per thread.
#pragma once

#include <cstddef>

namespace shearbus::physics {

// Users that may be active at the same time have scratch of their own.
enum class Scratch { kStages, kWaking, kAccepted, kFirstHalf, kSecondHalf };

double* scratch_tile(Scratch use, std::size_t doubles);

}  // namespace shearbus::physics
