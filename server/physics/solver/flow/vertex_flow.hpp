// Plastic flow of one vertex by the point functions of its flow law: for single lanes, and for laws without a kernel.
#pragma once

#include "server/physics/solver/flow/layer_flow.hpp"

namespace shearbus::physics {

struct FlowOfVertex {
  double dep = 0.0;    // plastic strain increment
  double slope = 0.0;  // derivative of dep by ln(a) at the same flux per stress a
};

// The flow at the temperature T after the step, of which the heat flux of the step has made the part `rise`  [K].
template <class Law>
FlowOfVertex flow_of_vertex(const Law& law, const FlowLoad& load, int lane, double T, double rise, double strain) {
  FlowOfVertex found;
  const auto take = [&](int, double dep, double slope) { found = {dep, slope}; };
  if constexpr (Law::kSeparable) {
    const SofteningExcess softened = law.softening_excess(load.bracket[lane], load.T_melt[lane], T);
    const double excess[] = {(load.load[lane] + softened.value) - law.log_strength(strain)};
    const double growth[] = {softened.rate * rise};
    if (excess[0] > 0.0) law.flow(excess, growth, &strain, take);
  } else {
    const double excess[] = {load.load[lane] - law.strength_at_rest(load.bracket[lane], load.T_melt[lane], T, strain)};
    const LoadedVertices<1> vertex{load.load + lane, load.bracket + lane, load.T_melt + lane, {T}, {rise}};
    if (excess[0] > 0.0) law.flow(vertex, excess, &strain, take);
  }
  return found;
}

}  // namespace shearbus::physics
