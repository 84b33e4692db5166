#include "server/physics/solver/force_driven/wide_slip.hpp"

#include <bit>
#include <cmath>
#include <cstddef>
#include <limits>

#include "server/physics/interface/friction_laws.hpp"

namespace shearbus::physics {
namespace {

// The searches of wide_stress() with the names of StressLimit and FrictionHeating, and their answers.
struct StressTile {
  alignas(64) double T_ad[kLanes], rise[kLanes], c[kLanes], b[kLanes];
  alignas(64) double coulomb[kLanes], offset[kLanes], T_melt[kLanes], bracket_at_0[kLanes];
  alignas(64) double a_stick[kLanes], guess[kLanes], stress[kLanes];
  double tresca, hT;
  SearchEffort* effort;
};

}  // namespace
}  // namespace shearbus::physics

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

std::uint32_t wide_stress(LaneSearch (&searches)[kLanes], std::uint32_t wanted) {
  std::uint32_t known = 0;
  StressTile tile{};
  for (const int l : lanes_of(wanted)) {
    const LaneSearch& search = searches[l];
    if (!has_quick_form(search.limit) || search.limit.junctions.options != nullptr) continue;
    known |= 1u << l;
    const Material& soft = *search.limit.soft;
    tile.T_ad[l] = search.heating.T_ad;
    tile.rise[l] = search.heating.rise;
    tile.c[l] = search.heating.c;
    tile.b[l] = search.heating.b;
    tile.coulomb[l] = search.limit.coulomb;
    tile.offset[l] = search.limit.offset;
    tile.T_melt[l] = soft.melting_temperature;
    tile.bracket_at_0[l] = 1.0 + soft.pressure_coefficient * search.limit.pressure;
    tile.a_stick[l] = search.a_stick;
    tile.guess[l] = search.guess;
    tile.tresca = search.limit.tresca;
    tile.hT = soft.temperature_coefficient;
    tile.effort = search.limit.effort;
  }
  if (known == 0) return 0;
  const std::uint32_t found = SHEARBUS_CALL(stress_step, tile, known);
  for (const int l : lanes_of(found)) searches[l].stress = tile.stress[l];
  return found;
}

std::uint32_t wide_slip(const WideSlip& slip, WideAnswer& answer) {
  return SHEARBUS_CALL(slip_step, slip, answer);
}

}  // namespace shearbus::physics
