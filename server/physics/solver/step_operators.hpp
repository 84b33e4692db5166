// What a step length costs once: the heat operator of dt and those of its halvings.
#pragma once

#include <deque>
#include <mutex>
#include <optional>
#include <vector>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/solver/layer_flow.hpp"

namespace shearbus::physics {

class StepOperators {
 public:
  // `halvings` operators beyond the first: dt/2, dt/4, ... Few steps ask for them, so that they are made when one does;
  // grids and materials, which are the model's, must outlive this.
  // `spread`: with what heat released across the layer needs. `basis`: of a model whose nodes sleep, or null.
  StepOperators(const Grid& layer, const HeatGrid& grid, const Material& soft, const Material& hard, double dt,
                int halvings, bool spread, const HeatBasis* basis)
      : grid_(grid), soft_(soft), hard_(hard), heat_(grid, soft, hard, dt) {
    if (basis != nullptr) decay_ = basis->decay(dt);
    for (int k = 1; k <= halvings; ++k) shorter_.emplace_back(grid, dt *= 0.5);
    num_heated_ = num_heated_vertices(layer, heat_.layer_response());
    if (!spread) return;
    spread_.emplace(grid, heat_, layer.num_vertices(), soft, hard);
    num_heated_ = layer.num_vertices();
  }

  const HeatOperator& heat() const { return heat_; }
  // Of dt / 2^k. Allocates nothing; several threads may ask at once.
  const HeatOperator& halved(int k) const {
    Shorter& shorter = shorter_[static_cast<std::size_t>(k) - 1];
    std::call_once(shorter.made, [&] { shorter.heat.factorise(grid_, soft_, hard_); });
    return shorter.heat;
  }
  int max_halvings() const { return static_cast<int>(shorter_.size()); }
  double dt() const { return heat_.dt; }
  const double* decay() const { return decay_.data(); }  // of the modes in which sleepers' heat is held
  const SpreadHeat& spread() const { return *spread_; }
  int num_heated() const { return num_heated_; }  // vertices the heat of one step of dt reaches

 private:
  struct Shorter {
    Shorter(const HeatGrid& grid, double dt) : heat(grid, dt) {}
    HeatOperator heat;
    std::once_flag made;
  };

  const HeatGrid& grid_;
  const Material& soft_;
  const Material& hard_;
  HeatOperator heat_;
  mutable std::deque<Shorter> shorter_;
  std::vector<double> decay_;
  std::optional<SpreadHeat> spread_;
  int num_heated_;
};

}  // namespace shearbus::physics
