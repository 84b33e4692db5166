// The kernels of layer_flow.hpp; each_register.hpp includes this file once per register width.
#if SHEARBUS_WIDTH > 1
#include "server/physics/material/flow_at_vertex.hpp"
#include "server/physics/material/flow_law_list.hpp"
#endif
#include "server/physics/solver/flow/expanded_flow_kernel.hpp"
#include "server/physics/solver/flow/searched_flow_kernel.hpp"

// Sums the flow of the lanes from `first` to the one before `end`.
inline void sum_flow(LayerFlow& flow, int first, int end, double* strain_new) {
  FlowLaws::with(flow.problem.soft->flow_law, [&](auto own) {
    using Law = typename decltype(own)::type;
    for (int lane = first; lane < end; lane += kWidth) {
      if (flow.problem.spread_response == nullptr) {
        sum_register<Law, false>(flow, lane, strain_new);
      } else {
        sum_register<Law, true>(flow, lane, strain_new);
      }
    }
  });
}

// Finds the strength H of a metal that does not flow yet, and its softening g, at z = 0 in the lanes from `first` to the
// one before `end`.
inline void find_first_vertices(const Material& soft, int first, int end, const double* pressure, const double* T,
                                const double* strain, FirstVertices& found) {
  FlowLaws::with(soft.flow_law, [&](auto own) {
    using Law = typename decltype(own)::type;
    for (int lane = first; lane < end; lane += kWidth) {
      const Register P = load(pressure + lane), T0 = load(T + lane);
      if constexpr (Law::kSeparable)
        store(Law::hardened(soft, load(strain + lane), all(0.0), P, T0), found.strength + lane);
      store(Law::softening(soft, P, T0).g, found.g + lane);
    }
  });
}
