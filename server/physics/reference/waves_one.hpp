// Stress, strain and velocity of one layer with inertia, scalar and slow: the twin of solver/layer_waves.
#pragma once

#include <vector>

#include "server/physics/reference/advance_one.hpp"

namespace shearbus::physics::reference {

// Advances the mechanical part of `state` at the temperatures T = T_ad + q B of the layer's vertices; q into `flux`.
NodeOutputs waves_one(const ModelOptions& options, double dt, const NodeInputs& inputs, const std::vector<double>& T_ad,
                      const std::vector<double>& B, double heat_share, NodeState& state, double& flux);

}  // namespace shearbus::physics::reference
