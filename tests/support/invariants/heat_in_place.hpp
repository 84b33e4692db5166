// An invariant of a layer with inertia whose plastic work heats in place: all heat comes from the work of the step.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "server/physics/solver/velocity_driven/inertia_stage.hpp"
#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/broken.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {

// Requires that the heat of a step is the fraction X of its plastic work, and all work of the slip of the interface, which
// is what the flow along s(0) leaves of [v], or under force [v] itself.
inline void require_heat_in_place(const Rig& rig, const Answered& a, int lane) {
  const TileLayout& layout = rig.model.layout();
  const auto stress = [&](int i) { return rig.committed[place(layout.shear_stress, i, lane)]; };
  const bool forced = rig.model.options().strategy == Strategy::kForceDriven;  // whose [v] is that of the interface
  const double eps = 4e-16;
  double work = 0.0, largest = 0.0, along = 0.0, all = 0.0, noise = 0.0, grain = 0.0;
  for (int i = 0; i < rig.model.grid().num_vertices(); ++i) {
    const double weight = kSqrt3 * rig.model.grid().weight[static_cast<std::size_t>(i)], ep = rig.ep(i, lane);
    const double flow = weight * (ep - rig.ep_of(rig.trial, i, lane));
    largest = std::max(largest, std::abs(stress(i)));
    work += std::abs(stress(i)) * flow;
    noise += std::abs(stress(i)) * (eps * weight * ep);
    all += flow;
    grain += eps * weight * ep;
    if (!forced && std::signbit(stress(i)) == std::signbit(stress(0))) along += flow;
  }
  double fastest = a.jump_length;
  for (int c = 0; c < rig.model.grid().num_cells(); ++c)
    fastest = std::max(fastest, std::abs(rig.committed[place(layout.layer_velocity, c, lane)]));
  const double slip = std::abs(a.slip) * a.dt;
  const double at_interface = std::abs(stress(0)) * std::max(0.0, slip - along);
  const double unknown = std::abs(stress(0)) * (grain + 1e-13 * (slip + along)) + kNoStress * (slip + all) +
                         2e-12 * largest * fastest * a.dt;
  require_near(a.heat, *rig.model.options().taylor_quinney_factor * work + at_interface,
               2e-9 * (work + at_interface) + noise + unknown + kProductOfDenormals, "heat against the work in place");
}

}  // namespace shearbus::testing
