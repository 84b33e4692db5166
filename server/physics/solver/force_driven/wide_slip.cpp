#include "server/physics/solver/force_driven/wide_slip.hpp"

#include <bit>
#include <cmath>
#include <cstddef>
#include <limits>

#include "server/physics/interface/friction_laws.hpp"

#define SHEARBUS_KERNELS "server/physics/solver/force_driven/wide_slip_kernel.hpp"
#include "server/physics/layer/each_register.hpp"

namespace shearbus::physics {

bool has_wide_slip(const Problem& problem) {
  const FrictionLawProperties friction = properties_of(problem.interface.friction_law);
  return !friction.depends_on_slip && !friction.depends_on_temperature && !problem.options.junctions &&
         std::isfinite(problem.interface.yield_strength) && FlowLaws::with(problem.options.soft.flow_law, [](auto law) {
           return kHasWideSoftening<typename decltype(law)::type>;
         });
}

std::uint32_t wide_slip(const WideSlip& slip, std::uint32_t wanted, WideAnswer& answer) {
  return SHEARBUS_CALL(slip_step, slip, wanted, answer);
}

}  // namespace shearbus::physics
