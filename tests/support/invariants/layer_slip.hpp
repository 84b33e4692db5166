// Slip balance of a velocity-driven layer, DLP (37) and (56).
#pragma once

#include <algorithm>
#include <cmath>

#include "tests/support/invariants/flow_stress.hpp"

namespace shearbus::testing {

// Requires the slip balance of a layer that carries all the slip: the plastic slip of the step, sqrt(3) times the
// integral of the plastic strain increment over the layer, is the imposed slip minus the elastic part h ds / G0. Here h
// is the thickness, ds the change of the stress and G0 the shear modulus of the layer.
inline void require_slip_balance(const Rig& rig, const Answered& a, int lane) {
  const ModelOptions& options = rig.model.options();
  if (options.drive != Drive::kLayerShear || a.pressure <= 0.0 || a.regime == Regime::kCoulomb) return;
  if (options.junctions) return;  // they may slip at their yield strength, too
  const bool may_have_turned = a.stress_old * a.stress < 0.0 || (a.stress == 0.0 && a.stress_old != 0.0);
  if (a.in_parts() && may_have_turned) return;               // the layer may have flowed in both directions
  if (a.in_parts() && options.friction_coefficient) return;  // the interface may have slipped in some substeps
  const double h = options.grid.thickness;
  const double wanted = std::abs(a.jump_old) * a.dt + h * std::abs(a.stress_old) / options.soft.shear_modulus;
  const double elastic = h * (a.stress - a.stress_old) / options.soft.shear_modulus;
  const double direction = a.stress != 0.0 ? std::copysign(1.0, a.stress) : std::copysign(1.0, a.slip);
  const double plastic = direction * (rig.plastic_slip(lane) - rig.plastic_slip_of(rig.trial, lane));
  // Tolerance [m]: the rounding error of the strains, and the change of the flow by rounding errors of stress and
  // temperature. Within a step of several substeps the stress may be larger, and the temperature nearer to melting,
  // than at the end; the tolerance of this step is therefore larger.
  const double share = a.in_parts() ? 1e-3 : 1e-9;
  const double stress = a.in_parts() ? std::max(std::abs(a.stress), std::abs(a.stress_old)) : a.stress;
  const double resolution = 1e-15 * rig.plastic_slip(lane) +
                            kSqrt3 * flow_grain(rig, strain_before(rig, lane), stress, lane, a.dt) +
                            kProductOfDenormals;
  require_near(plastic + elastic, a.jump_old * a.dt, share * wanted + resolution,
               "slip of the layer against the jump's");
  require_near(a.slip * a.dt, plastic, share * wanted + resolution, "[v] against the slip of the layer");
}

}  // namespace shearbus::testing
