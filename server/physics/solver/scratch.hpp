// Scratch states of one tile, owned by the calling thread. A scratch tile is allocated when the thread first needs it,
// and again only if a model has larger tiles.
#pragma once

#include <cstddef>

namespace shearbus::physics {

// The uses of a scratch tile. Uses that may overlap in time have separate tiles.
enum class Scratch {
  kStages,
  kWaking,
  kAccepted,
  kFirstHalf,
  kSecondHalf,
  kFlow,
  kStrain,
  kWorkHeat,
  kWaves,
  kVarying
};

double* scratch_tile(Scratch use, std::size_t doubles);

}  // namespace shearbus::physics
