// What a step length costs once: the heat operator of dt, those of its halvings, and those of the stages of a
// second-order step.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/layer/modes.hpp"
#include "server/physics/solver/layer_flow.hpp"
#include "server/physics/solver/sdirk2.hpp"

namespace shearbus::physics {

class StepOperators {
 public:
  // `halvings` operators beyond the first: dt/2, dt/4, ...
  // `spread`: with what heat released across the layer needs. `stages`: with those of SDIRK2.
  StepOperators(const Grid& layer, const HeatGrid& grid, const Material& soft, const Material& hard, double dt,
                int halvings, bool spread, bool stages)
      : dt_(dt) {
    if (stages) stage_.emplace(grid, soft, hard, sdirk2::kDiagonal * dt);
    heat_.reserve(static_cast<std::size_t>(halvings) + 1);
    for (int k = 0; k <= halvings; ++k, dt *= 0.5) heat_.emplace_back(grid, soft, hard, dt);
    num_heated_ = num_heated_vertices(layer, heat_.front().layer_response());
    if (!spread) return;
    spread_.emplace(grid, heat_.front(), layer.num_vertices(), soft, hard);
    num_heated_ = layer.num_vertices();
  }

  // Of a model that keeps no profile.
  StepOperators(const HeatModes& modes, double dt, int halvings, bool stages) : dt_(dt) {
    if (stages) mode_stages_.emplace(ModeStages{{modes, sdirk2::kDiagonal * dt}, {modes, dt, sdirk2::kDiagonal}});
    for (int k = 0; k <= halvings; ++k, dt *= 0.5) modes_.emplace_back(modes, dt);
  }

  const HeatOperator& heat(int halving = 0) const { return heat_[static_cast<std::size_t>(halving)]; }
  std::span<const HeatOperator> heats() const { return heat_; }   // of dt, dt/2, ...
  std::span<const ModeOperator> modes() const { return modes_; }  // likewise, where there is no profile
  int max_halvings() const { return static_cast<int>(heat_.size()) - 1; }
  double dt() const { return dt_; }
  const SpreadHeat& spread() const { return *spread_; }
  int num_heated() const { return num_heated_; }  // vertices the heat of one step of dt reaches

  // SDIRK2: both stages of a profile solve with the same operator; modes go over the first stage and over the step.
  struct ModeStages {
    ModeOperator first, second;
  };
  const HeatOperator& stage() const { return *stage_; }
  const ModeStages& mode_stages() const { return *mode_stages_; }

 private:
  double dt_;
  std::vector<HeatOperator> heat_;
  std::vector<ModeOperator> modes_;
  std::optional<SpreadHeat> spread_;
  std::optional<HeatOperator> stage_;
  std::optional<ModeStages> mode_stages_;
  int num_heated_ = 0;
};

}  // namespace shearbus::physics
