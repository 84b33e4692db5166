// The constant part of a model, shared by all solvers: options, grids, state layout.
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

  // Fraction of the heat capacity of the vertex at z = 0 that belongs to the soft body.
  double soft_share_at_interface() const {
    const double own = options.soft.conductivity / options.soft.diffusivity *
                       heat_grid.weight[static_cast<std::size_t>(heat_grid.interface)];
    return own / heat_grid.capacity(heat_grid.interface, options.soft, options.hard);
  }

  ModelOptions options;
  InterfaceOptions interface;  // interface law; velocity-driven: only the Coulomb limit, if the options give one
  Grid grid;
  HeatGrid heat_grid;
  std::optional<HeatModes> modes;  // modes that replace the temperature profile, if the scene has heat = "modes"
  TileLayout layout;
  std::optional<HeatBasis> basis;  // eigenmodes of heat conduction; set if nodes may sleep (ModelOptions::sleep)
  int steps_before_sleep = 0;      // number of steps at rest before a node sleeps
  int heat_rows;  // number of rows of temperatures, or of modes, in a tile, from layout.first_temperature() on
  // Share of the friction heat that enters the heat equation: beta_T if only the soft body is on the grid; 1 if both
  // bodies are, because conduction then divides the heat between them.
  double heat_partition;
  bool heat_varies;  // k or c of a body follows the temperature
};

// A step in which |slip - jump| / |jump| is larger than this has the outcome kOutsideDomain.
inline constexpr double kOutsideDomainShare = 0.1;

inline std::uint8_t outside_domain(double slip, double jump) {
  return std::abs(slip - jump) <= kOutsideDomainShare * std::abs(jump) ? 0 : kOutsideDomain;
}

// The shear stress of a lane before the step: `inputs.stress_before` if given, else the committed stress [Pa].
inline double stress_before(const TileLayout& layout, const TileInputs& inputs, const double* committed, int lane) {
  return inputs.stress_before ? inputs.stress_before[lane] : committed[layout.shear_stress + lane];
}

// The soft material at each lane's pressure; the same object for all lanes if the material does not depend on pressure.
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
  bool uniform() const { return !at_; }  // whether all lanes have the same material
  const Material& operator()(int lane) const { return at_ ? (*at_)[static_cast<std::size_t>(lane)] : soft_; }

 private:
  const Material& soft_;
  std::optional<std::array<Material, kLanes>> at_;
};

}  // namespace shearbus::physics
