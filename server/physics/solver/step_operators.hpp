// Heat operators of one step length: of dt, of its halvings, and of the stages of SDIRK2.
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/layer/modes.hpp"
#include "server/physics/solver/flow/layer_flow.hpp"
#include "server/physics/solver/sdirk2.hpp"

namespace shearbus::physics {

class StepOperators {
 public:
  // Operators of a model with a temperature profile. The `halvings` operators of dt/2, dt/4, ... are factorised when a
  // step first needs them. Grids and materials belong to the model and must outlive this object. `spread`: also makes
  // the operator of heat released across the layer. `stages`: also makes the operator of the stages of SDIRK2. `basis`:
  // eigenmodes of heat conduction for sleeping nodes, or null.
  StepOperators(const Grid& layer, const HeatGrid& grid, const Material& soft, const Material& hard, double dt,
                int halvings, bool spread, bool stages, const HeatBasis* basis)
      : dt_(dt), bodies_({&grid, &soft, &hard}), heat_(std::in_place, grid, soft, hard, dt) {
    if (stages) stage_.emplace(grid, soft, hard, sdirk2::kDiagonal * dt);
    // The stages of SDIRK2 are no product of factors of one sign; a sleeping node takes the exact factors in their place.
    if (basis != nullptr) decay_ = basis->decay(dt, stages);
    for (int k = 1; k <= halvings; ++k) shorter_.emplace_back(grid, dt *= 0.5);
    if (spread) spread_.emplace(grid, dt_, layer.num_vertices(), soft, hard);
  }

  // Operators of a model with modes instead of a profile. The modes belong to the model and must outlive this object.
  StepOperators(const HeatModes& modes, double dt, int halvings, bool stages)
      : dt_(dt), all_modes_(&modes), modes_(std::in_place, modes, dt) {
    if (stages) mode_stages_.emplace(ModeStages{{modes, sdirk2::kDiagonal * dt}, {modes, dt, sdirk2::kDiagonal}});
    for (int k = 1; k <= halvings; ++k) shorter_modes_.emplace_back(modes.num_rows(), dt *= 0.5);
  }

  // The heat operator of a step of length dt / 2^k. Thread-safe, without allocation.
  const HeatOperator& heat(int k = 0) const {
    if (k == 0) return *heat_;
    Shorter<HeatOperator>& shorter = shorter_[static_cast<std::size_t>(k) - 1];
    std::call_once(shorter.made, [&] { shorter.heat.factorise(*bodies_.grid, *bodies_.soft, *bodies_.hard); });
    return shorter.heat;
  }
  const ModeOperator& modes(int k = 0) const {
    if (k == 0) return *modes_;
    Shorter<ModeOperator>& shorter = shorter_modes_[static_cast<std::size_t>(k) - 1];
    std::call_once(shorter.made, [&] { shorter.heat.fill(*all_modes_); });
    return shorter.heat;
  }
  // Number of operators for dt/2, dt/4, ...: of HeatOperators with a profile, of ModeOperators with modes.
  int max_halvings() const { return static_cast<int>(shorter_.size() + shorter_modes_.size()); }

  // For models with a tolerance: StepOperators of dt/2, dt/4, ... Each is made at its first use; thread-safe.
  using MakeHalved = std::function<std::unique_ptr<const StepOperators>(int times)>;
  void allow_halving(int most_times, MakeHalved make) {
    make_halved_ = std::move(make);
    while (most_times-- > 0) halved_.emplace_back();
  }
  const StepOperators& halved(int times) const {
    if (times == 0) return *this;
    Halved& halved = halved_[static_cast<std::size_t>(times) - 1];
    std::call_once(halved.made, [&] { halved.operators = make_halved_(times); });
    return *halved.operators;
  }
  int most_times_halved() const { return static_cast<int>(halved_.size()); }

  double dt() const { return dt_; }
  // Factor by which a step multiplies each mode of a sleeping node.
  const double* decay() const { return decay_.data(); }
  const SpreadHeat& spread() const { return *spread_; }

  // SDIRK2: with a profile both stages use the operator of gamma dt; with modes the operator of the second stage covers
  // the whole step.
  struct ModeStages {
    ModeOperator first, second;
  };
  const HeatOperator& stage() const { return *stage_; }
  // The operator of a step with a constant heat flux, to second order; null where a step conducts by backward Euler alone.
  // Its coefficients are those of a stage, its length and its response those of the whole step.
  const HeatOperator* even() const { return even_ ? &*even_ : nullptr; }
  void make_even() {
    even_.emplace(*bodies_.grid, *bodies_.soft, *bodies_.hard, sdirk2::kDiagonal * dt_);
    sdirk2::respond_to_constant_flux(*even_, dt_);
  }
  const ModeStages& mode_stages() const { return *mode_stages_; }

 private:
  struct Bodies {
    const HeatGrid* grid = nullptr;
    const Material* soft = nullptr;
    const Material* hard = nullptr;
  };
  template <class Heat>
  struct Shorter {
    template <class Size>
    Shorter(const Size& size, double dt) : heat(size, dt) {}
    Heat heat;
    std::once_flag made;
  };
  struct Halved {
    std::unique_ptr<const StepOperators> operators;
    std::once_flag made;
  };

  double dt_;
  Bodies bodies_;
  std::optional<HeatOperator> heat_;
  mutable std::deque<Shorter<HeatOperator>> shorter_;
  std::vector<double> decay_;
  const HeatModes* all_modes_ = nullptr;
  std::optional<ModeOperator> modes_;
  mutable std::deque<Shorter<ModeOperator>> shorter_modes_;
  mutable std::deque<Halved> halved_;
  MakeHalved make_halved_;
  std::optional<SpreadHeat> spread_;
  std::optional<HeatOperator> stage_, even_;
  std::optional<ModeStages> mode_stages_;
};

struct Problem;
// Operators of a step of dt / 2^times. `times`: how often the tolerance has halved the step. A force-driven step with
// several answers may then be halved (force_driven/substeps.hpp) that many times less, so that the shortest substep does
// not depend on the tolerance.
std::unique_ptr<StepOperators> make_operators(const Problem& problem, double dt, int times);

}  // namespace shearbus::physics
