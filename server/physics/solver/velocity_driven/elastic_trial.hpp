// The stress of a velocity-driven layer that only shears elastically (server/physics/MODEL.md, "Velocity-driven step"):
// DLP (37), (56). It is the answer of the step if the layer is at rest and neither layer nor interface yields under it.
#pragma once

#include <algorithm>

#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

struct ElasticTrial {
  double stress;     // elastic trial stress s_old + G0 dt w / h, signed; w: driving_velocity()  [Pa]
  double direction;  // sign of the trial stress; if that is 0, sign of the jump
  double heating;    // heat flux into the soft body per |stress|: beta_T max([V] direction, 0)  [m/s]

  bool heats() const { return stress != 0.0 && heating > 0.0; }
};

// The velocity w that shears the layer: the velocity jump, or with INTERFACE_SLIP the host's own shear rate times the
// thickness  [m/s].
inline double driving_velocity(const Problem& problem, const TileInputs& inputs, int lane) {
  if (problem.options.drive == Drive::kLayerShear) return inputs.velocity_jump[lane];
  return problem.options.grid.thickness * inputs.soft_shear_rate[lane];
}

inline ElasticTrial elastic_trial(const Problem& problem, const Material& soft, const TileInputs& inputs, int lane,
                                  double dt, double s_start) {
  const double h = problem.options.grid.thickness;
  const double jump = inputs.velocity_jump[lane];
  const double stress = s_start + soft.shear_modulus * dt * driving_velocity(problem, inputs, lane) / h;
  const double direction = (stress != 0.0 ? stress : jump) < 0.0 ? -1.0 : 1.0;
  return {stress, direction, problem.heat_partition * std::max(0.0, direction * jump)};
}

}  // namespace shearbus::physics
