// What a model knows before the first step: shared by both strategies, constant afterwards.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/layer/grid.hpp"
#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/layer/modes.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/model.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

struct Problem {
  explicit Problem(const ModelOptions& model_options);

  // Of the heat that the vertex at z = 0 holds.
  double soft_share_at_interface() const {
    const double own = options.soft.conductivity / options.soft.diffusivity *
                       heat_grid.weight[static_cast<std::size_t>(heat_grid.interface)];
    return own / heat_grid.capacity(heat_grid.interface, options.soft, options.hard);
  }

  ModelOptions options;
  InterfaceOptions interface;  // interface law of the strategy; velocity-driven: the Coulomb limit, if any, no yield
  Grid grid;
  HeatGrid heat_grid;
  std::optional<HeatModes> modes;  // in place of a profile
  TileLayout layout;
  std::optional<HeatBasis> basis;  // where nodes at rest sleep
  int steps_before_sleep = 0;
  int heat_rows;          // of the heat's state in a tile, from layout.first_temperature() on
  double heat_partition;  // share of the friction power the conducting bodies take: beta_T, or all where both conduct
};

inline constexpr double kOutsideDomainShare = 0.1;  // slip may differ from an imposed jump by this much of it

inline std::uint8_t outside_domain(double slip, double jump) {
  return std::abs(slip - jump) <= kOutsideDomainShare * std::abs(jump) ? 0 : kOutsideDomain;
}

// The stress a lane's step starts from.
inline double stress_before(const TileLayout& layout, const TileInputs& inputs, const double* committed, int lane) {
  return inputs.stress_before ? inputs.stress_before[lane] : committed[layout.shear_stress + lane];
}

// The soft body as it is at each lane's pressure; itself where pressure does not change it.
class LaneMaterials {
 public:
  LaneMaterials(const Material& soft, const TileInputs& inputs) : soft_(soft) {
    if (!soft.varies_with_compression()) return;
    at_.emplace();
    for (int l = 0; l < kLanes; ++l) {
      const bool active = contains(inputs.active, l);
      (*at_)[static_cast<std::size_t>(l)] = at_pressure(soft, active ? inputs.pressure[l] : 0.0);
    }
  }
  const Material& operator()(int lane) const { return at_ ? (*at_)[static_cast<std::size_t>(lane)] : soft_; }

 private:
  const Material& soft_;
  std::optional<std::array<Material, kLanes>> at_;
};

}  // namespace shearbus::physics
