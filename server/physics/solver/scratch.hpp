// Scratch states of one tile, owned by the calling thread. A scratch tile is allocated when the thread first needs it,
// and again only if a model has larger tiles.
#pragma once

#include <cstddef>

namespace shearbus::physics {

// What a scratch tile is used for. Uses that may overlap in time have a tile each.
enum class Scratch { kStages, kWaking, kAccepted, kFirstHalf, kSecondHalf };

double* scratch_tile(Scratch use, std::size_t doubles);

}  // namespace shearbus::physics
