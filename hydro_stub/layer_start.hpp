// Temperatures at which the layers of a two-dimensional problem start.
#pragma once

#include <vector>

#include "hydro_stub/problem2d.hpp"
#include "hydro_stub/scene.hpp"

namespace shearbus::hydro {

// Refuses hydro.layer_start "shocked" for a problem or an interface law without layers to heat.
void check_layer_start(const guest::HydroScene& scene, std::size_t interface_nodes);

// Returns the initial temperature of each interface node [K]: layer.initial_temperature_k, or with "shocked" the
// temperature that its soft zones have at its highest pressure in a run of the same bodies without friction. A node that
// such a run never loads keeps that of the layer.
std::vector<double> layer_start(const guest::HydroScene& scene, const Problem2d& problem, bool progress);

}  // namespace shearbus::hydro
