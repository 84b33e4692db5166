// What a step length costs once: the heat operator of dt and those of its halvings.
#pragma once

#include <vector>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/solver/layer_flow.hpp"

namespace shearbus::physics {

class StepOperators {
 public:
  // `halvings` operators beyond the first: dt/2, dt/4, ...
  StepOperators(const Grid& layer, const HeatGrid& grid, const Material& soft, const Material& hard, double dt,
                int halvings) {
    heat_.reserve(static_cast<std::size_t>(halvings) + 1);
    for (int k = 0; k <= halvings; ++k, dt *= 0.5) heat_.emplace_back(grid, soft, hard, dt);
    num_heated_ = num_heated_vertices(layer, heat_.front().layer_response());
  }

  const HeatOperator& heat(int halving = 0) const { return heat_[static_cast<std::size_t>(halving)]; }
  int max_halvings() const { return static_cast<int>(heat_.size()) - 1; }
  double dt() const { return heat_.front().dt; }
  int num_heated() const { return num_heated_; }  // vertices the heat of one step of dt reaches

 private:
  std::vector<HeatOperator> heat_;
  int num_heated_;
};

}  // namespace shearbus::physics
