// What a step length costs once: the heat operator of dt and those of its halvings.
#pragma once

#include <optional>
#include <vector>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/solver/layer_flow.hpp"

namespace shearbus::physics {

class StepOperators {
 public:
  // `halvings` operators beyond the first: dt/2, dt/4, ...
  // `spread`: with what heat released across the layer needs.
  StepOperators(const Grid& layer, const HeatGrid& grid, const Material& soft, const Material& hard, double dt,
                int halvings, bool spread) {
    heat_.reserve(static_cast<std::size_t>(halvings) + 1);
    for (int k = 0; k <= halvings; ++k, dt *= 0.5) heat_.emplace_back(grid, soft, hard, dt);
    num_heated_ = num_heated_vertices(layer, heat_.front().layer_response());
    if (!spread) return;
    spread_.emplace(grid, heat_.front(), layer.num_vertices(), soft, hard);
    num_heated_ = layer.num_vertices();
  }

  const HeatOperator& heat(int halving = 0) const { return heat_[static_cast<std::size_t>(halving)]; }
  int max_halvings() const { return static_cast<int>(heat_.size()) - 1; }
  double dt() const { return heat_.front().dt; }
  const SpreadHeat& spread() const { return *spread_; }
  int num_heated() const { return num_heated_; }  // vertices the heat of one step of dt reaches

 private:
  std::vector<HeatOperator> heat_;
  std::optional<SpreadHeat> spread_;
  int num_heated_;
};

}  // namespace shearbus::physics
