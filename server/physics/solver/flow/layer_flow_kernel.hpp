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
