// Scratch states of one tile, owned by the calling thread. A scratch tile is allocated when the thread first needs it,
// and again only if a model has larger tiles.
#pragma once

#include <cstddef>
#include <vector>

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

inline double* scratch_tile(Scratch use, std::size_t doubles) {
  thread_local std::vector<double> tiles[static_cast<std::size_t>(Scratch::kVarying) + 1];
  std::vector<double>& tile = tiles[static_cast<std::size_t>(use)];
  if (tile.size() < doubles) tile.resize(doubles);
  return tile.data();
}

}  // namespace shearbus::physics
