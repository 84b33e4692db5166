#include "server/physics/solver/force_driven/wide_slip.hpp"

#include <bit>
#include <cmath>
#include <cstddef>
#include <limits>

#include "server/physics/interface/friction_laws.hpp"

#define SHEARBUS_KERNELS "server/physics/solver/force_driven/wide_slip_kernel.hpp"
#include "server/physics/layer/each_register.hpp"

namespace shearbus::physics {

namespace {

bool has_wide_softening(FlowLaw flow_law) {
  return FlowLaws::with(flow_law, [](auto law) { return kHasWideSoftening<typename decltype(law)::type>; });
}

}  // namespace

bool has_wide_slip(const Problem& problem) {
  const FrictionLawProperties friction = properties_of(problem.interface.friction_law);
  return !friction.depends_on_slip && !friction.depends_on_temperature && !problem.options.junctions &&
         std::isfinite(problem.interface.yield_strength) && has_wide_softening(problem.options.soft.flow_law);
}

std::optional<LaneStep> quick_slip(const StressLimit& limit, const TrialSlip& trial, double heat_partition, double B0,
                                   double T_ad, double guess) {
  const Material& soft = *limit.soft;
  const bool known = limit.varying == nullptr && limit.offset == 0.0 && std::isfinite(limit.tresca) &&
                     !soft.varies_with_compression() && has_wide_softening(soft.flow_law);
  if (!known) return {};
  const FrictionHeating heating = trial.slipping(T_ad, heat_partition * B0);
  const one::Lanes lane{T_ad,
                        heating.rise,
                        heating.c,
                        heating.b,
                        limit.coulomb,
                        0.0,
                        soft.melting_temperature,
                        1.0 + soft.pressure_coefficient * limit.pressure,
                        limit.tresca,
                        soft.temperature_coefficient,
                        limit.junctions.options ? &limit.junctions : nullptr};
  return one::slip_of_lane(
      lane, {trial.jump_free, trial.per_stress, trial.direction, trial.jump_old, trial.drive, trial.stress_stick},
      heat_partition, B0, guess, limit.effort);
}

std::uint32_t wide_slip(const WideSlip& slip, WideAnswer& answer) {
  return SHEARBUS_CALL(slip_step, slip, answer);
}

}  // namespace shearbus::physics
