// An invariant of server/physics/MODEL.md, "What always holds": temperatures stay below melting and in their range.
// This file also checks that they fall with the distance from the interface where only the interface is heated.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/broken.hpp"
#include "tests/support/invariants/interface_limits.hpp"
#include "tests/support/invariants/melt_film.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {

// Requires that a temperature T is below T_melt, or not above `hottest`, the highest temperature before the step.
inline void require_solid(double T, double T_melt, double hottest, Figures& figures) {
  require(T < T_melt || T <= hottest * (1 + 1e-15), "T {:.17g} K, melting {:.17g} K, hottest before {:.17g} K", T,
          T_melt, hottest);
  figures.nearest_melting = std::min(figures.nearest_melting, std::abs(T_melt - T));
}

// Requires that temperatures stay in their range. If only the interface is heated, they must also fall with the
// distance from the interface.
inline void require_temperatures(const Rig& rig, const Answered& a, int lane, Figures& figures) {
  const ModelOptions& options = rig.model.options();
  const TileLayout& layout = rig.model.layout();
  const bool has_profile = layout.heat_modes == TileLayout::kAbsent;
  const double T_melt = at_pressure(options.soft, a.pressure).melting_temperature;
  const std::vector<double> before = rig.temperatures(rig.trial, lane), after = rig.temperatures(rig.committed, lane);
  const std::size_t interface = layout.num_hard_vertices;
  const double grain = rig.slept(lane) ? kSleeperGrain : 0.0;
  require(std::abs(a.T0 - after[interface]) <= grain, "T0 {:.17g} is not that of the state, {:.17g}", a.T0,
          after[interface]);
  double coldest = *std::min_element(before.begin(), before.end());
  // with heat modes instead of a temperature profile, the first value of the modes is the initial temperature
  if (!has_profile) coldest = std::min(coldest, rig.trial[layout.heat_modes + lane]);
  const double hottest = *std::max_element(before.begin(), before.end());
  // Under a tolerance the heat next to a layer that may flow is conducted to second order.
  const bool first_order =
      options.time_integrator == TimeIntegrator::kBackwardEuler && !(options.tolerance && options.plastic_layer);
  const bool falls_inwards = !options.hard_grid && first_order;
  // Metal that a fallen melting temperature has left above it melts, and cools to it.
  if (options.melt_film) coldest = std::min(coldest, T_melt);
  for (std::size_t i = 0; i < after.size(); ++i) {
    const double T = after[i];
    const int vertex = static_cast<int>(i) - static_cast<int>(interface);
    require(T >= coldest - grain, "vertex {} cools to {:.17g} K, below all before ({:.17g} K)", vertex, T, coldest);
    // The melting temperature of the soft body is no bound of the hard body's temperatures. The hard body gets its heat
    // through the interface, so its bound is the highest temperature before the step or the interface temperature T0.
    if (i < interface) {
      // T0 is the temperature at the end of the step; during substeps the interface may be hotter. A step of second
      // order extrapolates in time and may exceed the bound by a few percent.
      const bool second_order = options.time_integrator == TimeIntegrator::kSdirk2;
      const double there_was = std::max(hottest, a.in_parts() || second_order ? std::max(T_melt, a.T0) : a.T0);
      require(T <= there_was * (second_order ? 1.1 : 1 + 1e-14) + grain,
              "vertex {} heats to {:.17g} K above all there was", vertex, T);
    } else if (options.melt_film) {
      require_phase(T, rig.liquid(vertex, lane), T_melt);
    } else {
      // Bodies of almost no mass slip so fast that the heat of an ulp of their jump melts everything.
      const bool forced = options.strategy == Strategy::kForceDriven;
      const double heated = forced ? heat_grain(options, a, a.size()) : 0.0;
      require_solid(T, T_melt, hottest + grain + (heated > 1.0 ? heated : 0.0), figures);
    }
    // Far from the interface, where T is uniform, a node that has slept keeps the last digits of its modes, which are
    // digits of the hottest temperature that they ever added up to; each of tens of thousands of sleeps adds some.
    const double kept = options.sleep ? 1e-13 * T_melt : 0.0;
    require(i <= interface || !falls_inwards || T <= after[i - 1] * (1 + 1e-15) + kept + grain,
            "T rises with z at vertex {}: {:.17g} K", vertex, T);
  }
}

}  // namespace shearbus::testing
