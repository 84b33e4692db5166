#include "server/physics/solver/scratch.hpp"

#include <vector>

namespace shearbus::physics {

double* scratch_tile(Scratch use, std::size_t doubles) {
  thread_local std::vector<double> tiles[static_cast<std::size_t>(Scratch::kVarying) + 1];
  std::vector<double>& tile = tiles[static_cast<std::size_t>(use)];
  if (tile.size() < doubles) tile.resize(doubles);
  return tile.data();
}

}  // namespace shearbus::physics
