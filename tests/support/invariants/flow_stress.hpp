// Invariants of a layer: it flows only where its stress equals its flow stress, and its plastic strain never falls.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/broken.hpp"
#include "tests/support/invariants/heat_of_work.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {

inline std::vector<double> strain_before(const Rig& rig, int lane) {
  std::vector<double> ep(static_cast<std::size_t>(rig.model.grid().num_vertices()));
  for (std::size_t i = 0; i < ep.size(); ++i) ep[i] = rig.ep_of(rig.trial, static_cast<int>(i), lane);
  return ep;
}

// What the last digits of the stress of a vertex are as plastic strain. The strain of waves is what shear and stress leave of
// each other; at a face whose light body gives way it is what the far stress, less that of the face, moves the body by,
// over the weight of the vertex.
inline double strain_of_digits(const Rig& rig, int vertex, int lane, double carried, double dt) {
  const ModelOptions& options = rig.model.options();
  const Grid& grid = rig.model.grid();
  if (!options.inertia) return 0.0;
  const double digits = kDigits * carried / (kSqrt3 * options.soft.shear_modulus);
  if (options.strategy != Strategy::kForceDriven || (vertex > 0 && vertex < grid.num_cells())) return digits;
  const double mass =
      vertex == 0 ? rig.inputs.mass_hard[lane] : rig.inputs.mass_soft[lane] - options.soft.density * grid.vertex.back();
  const double moved = kDigits * carried * dt / mass * dt;
  return digits + moved / (kSqrt3 * grid.weight[static_cast<std::size_t>(vertex)]);
}

// Requires that the stress of a layer is at most its flow stress and equal to it where the layer flows, and that no
// plastic strain decreases. `grain`: accepted error of the temperatures, besides that of their last digits  [K].
inline void require_complementary_flow(const Rig& rig, const Answered& a, int lane, double grain, Figures& figures) {
  const ModelOptions& options = rig.model.options();
  const TileLayout& layout = rig.model.layout();
  const Material soft = at_pressure(options.soft, a.pressure);
  const std::vector<double> profile = rig.layer_temperatures(lane);
  for (int i = 0; i < rig.model.grid().num_vertices(); ++i) {
    const double carried =
        options.inertia ? std::abs(rig.committed[place(layout.shear_stress, i, lane)]) : std::abs(a.stress);
    const double ep = rig.ep(i, lane), ep_old = rig.ep_of(rig.trial, i, lane);
    require(ep >= ep_old, "ep falls at vertex {}: {:.17g} from {:.17g}", i, ep, ep_old);
    if (a.pressure <= 0.0) continue;
    // dep / dt is an upper bound of the strain rate: all the strain may have grown in the last of several substeps.
    // `dep` has the rounding error of a difference of strains. At a rate that is too small to matter in the flow law
    // the strain follows from the stress by hardening alone; the rounding error of the stress then adds to that of
    // `dep`. A strain that grows by less than its last digit in the last of several substeps may do so at any rate up
    // to that.
    // All of it may have grown in the second of two stages.
    const double of_stage = options.inertia && of_two_stages(options, a) ? 1.0 / 0.29289321881345254 : 1.0;
    const double dep = a.parts() * (ep - ep_old);
    const double T = profile[static_cast<std::size_t>(i)];
    const bool rated = properties_of(soft.flow_law).depends_on_rate;
    const double slope = rated && ep > 0.0 ? hardening_slope(soft, ep, 0.0, a.dt, a.pressure, T) : 0.0;
    const double at_rest = hardened_strength(soft, ep, 0.0, a.pressure, T);
    const double noise = 4e-16 * ep + (slope > 0.0 ? kDigits * at_rest / slope : 0.0);
    const double digits = strain_of_digits(rig, i, lane, carried, a.dt);
    const auto limit = [&](double strain, double temperature, double increment) {
      return flow_stress(soft, std::max(0.0, strain), a.pressure, temperature, increment / a.dt) / kSqrt3;
    };
    const double most = limit(ep + digits, T * (1 - kDigits) - grain,
                              of_stage * (dep + noise + digits + (a.parts() - 1) * (4e-16 * ep)));
    // A molten vertex among waves may keep what is no stress. That of a law with a rate is what its strain leaves of the
    // shear, known to the last digits of that.
    const double kept = rated ? kDigits * (kSqrt3 * options.soft.shear_modulus * dep) : 0.0;
    const double nothing = options.inertia ? 1e-39 + kept : 0.0;  // [Pa]
    require(carried <= most * (1 + 1e-10) + nothing,
            "vertex {} carries {:.17g} Pa, its flow stress {:.17g}, T {:.17g}, ep {}", i, carried, most, T, ep);
    if (most > nothing) figures.over_limit = std::max(figures.over_limit, carried / most - 1.0);
    // A vertex counts as flowing only if its plastic strain increment exceeds the rounding error of the strain.
    const bool forced = options.strategy == Strategy::kForceDriven;
    const bool held_by_friction = options.inertia && i == 0 && (a.regime == Regime::kCoulomb || (forced && !a.sticks));
    // The vertex may have flowed in an earlier substep or stage only, at another stress.
    // Where the work of waves leaps, the layer is as cool as its work makes it, and no warmer under the stress.
    const bool leaps = options.inertia && options.taylor_quinney_factor && (a.outcome & kMultipleRoots) != 0;
    if (a.in_parts() || leaps || (options.inertia && of_two_stages(options, a))) continue;
    if (ep <= ep_old * (1 + 1e-12) + 1e-15 + digits || held_by_friction) continue;
    const double least = limit(ep - digits, T * (1 + kDigits) + grain, dep - noise - digits);
    require(carried + nothing >= least * (1 - 1e-10),
            "vertex {} flows under {:.17g} Pa, its flow stress {:.17g}, T {:.17g}, ep {} from {}", i, carried, least, T,
            ep, ep_old);
  }
}

}  // namespace shearbus::testing
