// What a step length costs once: the heat operator of dt, those of its halvings, and those of the stages of a
// second-order step.
#pragma once

#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/layer/modes.hpp"
#include "server/physics/solver/layer_flow.hpp"
#include "server/physics/solver/sdirk2.hpp"

namespace shearbus::physics {

class StepOperators {
 public:
  // `halvings` operators beyond the first: dt/2, dt/4, ... Few steps ask for them, so that they are made when one does;
  // grids and materials, which are the model's, must outlive this.
  // `spread`: with what heat released across the layer needs. `stages`: with those of SDIRK2. `basis`: of a model whose
  // nodes sleep, or null.
  StepOperators(const Grid& layer, const HeatGrid& grid, const Material& soft, const Material& hard, double dt,
                int halvings, bool spread, bool stages, const HeatBasis* basis)
      : dt_(dt), bodies_({&grid, &soft, &hard}), heat_(std::in_place, grid, soft, hard, dt) {
    if (stages) stage_.emplace(grid, soft, hard, sdirk2::kDiagonal * dt);
    if (basis != nullptr) decay_ = basis->decay(dt);
    for (int k = 1; k <= halvings; ++k) shorter_.emplace_back(grid, dt *= 0.5);
    num_heated_ = num_heated_vertices(layer, heat_->layer_response());
    if (!spread) return;
    spread_.emplace(grid, *heat_, layer.num_vertices(), soft, hard);
    num_heated_ = layer.num_vertices();
  }

  // Of a model that keeps no profile.
  StepOperators(const HeatModes& modes, double dt, int halvings, bool stages) : dt_(dt) {
    if (stages) mode_stages_.emplace(ModeStages{{modes, sdirk2::kDiagonal * dt}, {modes, dt, sdirk2::kDiagonal}});
    for (int k = 0; k <= halvings; ++k, dt *= 0.5) modes_.emplace_back(modes, dt);
  }

  const HeatOperator& heat() const { return *heat_; }
  // Of dt / 2^k. Allocates nothing; several threads may ask at once.
  const HeatOperator& heat_halved(int k) const {
    Shorter& shorter = shorter_[static_cast<std::size_t>(k) - 1];
    std::call_once(shorter.made, [&] { shorter.heat.factorise(*bodies_.grid, *bodies_.soft, *bodies_.hard); });
    return shorter.heat;
  }
  std::span<const ModeOperator> modes() const { return modes_; }  // of dt, dt/2, ..., where there is no profile
  int max_halvings() const { return static_cast<int>(shorter_.size()); }

  // Where the error of a step is controlled: those of its halves, quarters, ...
  void add_halved(std::unique_ptr<const StepOperators> operators) { halved_.push_back(std::move(operators)); }
  const StepOperators& halved(int times) const {
    return times == 0 ? *this : *halved_[static_cast<std::size_t>(times) - 1];
  }
  int times_halved() const { return static_cast<int>(halved_.size()); }

  // Of the model that a shadow is solved with, where its own are not these.
  void set_full(std::shared_ptr<const StepOperators> operators) { full_ = std::move(operators); }
  const StepOperators& full() const { return full_ ? *full_ : *this; }

  double dt() const { return dt_; }
  const double* decay() const { return decay_.data(); }  // of the modes in which sleepers' heat is held
  const SpreadHeat& spread() const { return *spread_; }
  int num_heated() const { return num_heated_; }  // vertices the heat of one step of dt reaches

  // SDIRK2: both stages of a profile solve with the same operator; modes go over the first stage and over the step.
  struct ModeStages {
    ModeOperator first, second;
  };
  const HeatOperator& stage() const { return *stage_; }
  const ModeStages& mode_stages() const { return *mode_stages_; }

 private:
  struct Bodies {
    const HeatGrid* grid = nullptr;
    const Material* soft = nullptr;
    const Material* hard = nullptr;
  };
  struct Shorter {
    Shorter(const HeatGrid& grid, double dt) : heat(grid, dt) {}
    HeatOperator heat;
    std::once_flag made;
  };

  double dt_;
  Bodies bodies_;
  std::optional<HeatOperator> heat_;
  mutable std::deque<Shorter> shorter_;
  std::vector<double> decay_;
  std::vector<ModeOperator> modes_;
  std::vector<std::unique_ptr<const StepOperators>> halved_;
  std::shared_ptr<const StepOperators> full_;
  std::optional<SpreadHeat> spread_;
  std::optional<HeatOperator> stage_;
  std::optional<ModeStages> mode_stages_;
  int num_heated_ = 0;
};

}  // namespace shearbus::physics
