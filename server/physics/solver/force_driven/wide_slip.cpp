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

// Whether the search for one lane has the form of this limit.
bool has_quick_form(const StressLimit& limit) {
  return limit.varying == nullptr && std::isfinite(limit.tresca) && !limit.soft->varies_with_compression() &&
         has_wide_softening(limit.soft->flow_law);
}

one::Lanes lane_of(const StressLimit& limit, const FrictionHeating& heating) {
  const Material& soft = *limit.soft;
  return {heating.T_ad,
          heating.rise,
          heating.c,
          heating.b,
          limit.coulomb,
          limit.offset,
          soft.melting_temperature,
          1.0 + soft.pressure_coefficient * limit.pressure,
          limit.tresca,
          soft.temperature_coefficient,
          limit.junctions.options ? &limit.junctions : nullptr};
}

}  // namespace

bool has_wide_slip(const Problem& problem) {
  const FrictionLawProperties friction = properties_of(problem.interface.friction_law);
  return !friction.depends_on_slip && !friction.depends_on_temperature && !problem.options.junctions &&
         std::isfinite(problem.interface.yield_strength) && has_wide_softening(problem.options.soft.flow_law);
}

std::optional<LaneStep> quick_slip(const StressLimit& limit, const TrialSlip& trial, double heat_partition, double B0,
                                   double T_ad, double guess) {
  if (!has_quick_form(limit) || limit.offset != 0.0) return {};
  return one::slip_of_lane(
      lane_of(limit, trial.slipping(T_ad, heat_partition * B0)),
      {trial.jump_free, trial.per_stress, trial.direction, trial.jump_old, trial.drive, trial.stress_stick},
      heat_partition, B0, guess, limit.effort);
}

std::optional<double> quick_stress(const StressLimit& limit, const FrictionHeating& heating, double a_stick,
                                   double guess) {
  if (!has_quick_form(limit)) return {};
  return one::stress_of_lane(lane_of(limit, heating), a_stick, guess, limit.effort);
}

std::uint32_t wide_slip(const WideSlip& slip, WideAnswer& answer) {
  return SHEARBUS_CALL(slip_step, slip, answer);
}

}  // namespace shearbus::physics
