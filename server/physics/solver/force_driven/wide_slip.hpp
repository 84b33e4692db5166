// Stress and slip of all lanes of a tile at once (METHODS.md, "Arithmetic"), for models whose interface has constant
// friction, no junctions, and a flow law whose softening has a form for registers. A lane with a rarer answer is left
// to InterfaceStep.
#pragma once

#include <cstdint>
#include <optional>
#include <type_traits>

#include "server/physics/material/steinberg_cochran_guinan.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

// Whether the kernel has the softening of this flow law. Closed by default: another law takes the step lane by lane.
template <class Law>
inline constexpr bool kHasWideSoftening = std::is_same_v<Law, SteinbergCochranGuinan>;

// What the steps of the lanes of a tile have in common, and where their inputs are.
struct WideSlip {
  const TileInputs& inputs;
  const LaneMaterials& soft_at;
  const double* stress_before;  // stress before the step  [Pa]
  const double* T_ad;           // interface temperature without friction in this step  [K]
  double friction_coefficient;
  double tresca;  // shear strength of the interface, yield strength / sqrt(3)  [Pa]
  double heat_partition;
  double B0;  // rise of T0 per heat flux  [K m2/W]
  double dt;
};

// The answers of the solved lanes, as LaneStep has them. The flux of all other lanes is 0.
struct WideAnswer {
  alignas(64) double stress[kLanes];
  alignas(64) double slip[kLanes];
  alignas(64) double jump_new[kLanes];
  alignas(64) double flux[kLanes];
  alignas(64) double heat[kLanes];  // friction heat of the step  [J/m2]
  alignas(64) double regime[kLanes];
};

// Whether the kernel has the model's interface.
bool has_wide_slip(const Problem& problem);

// Solves the active lanes and returns those whose answer is unique and was found. The answer of a lane depends on this
// lane alone.
std::uint32_t wide_slip(const WideSlip& slip, WideAnswer& answer);

// The same algorithm for one lane, with or without junctions. Returns nothing where the limit has another form, the
// answer may not be unique, or the search fails: rigid_slip() then takes the general way.
std::optional<LaneStep> quick_slip(const StressLimit& limit, const TrialSlip& trial, double heat_partition, double B0,
                                   double T_ad, double guess);

// A search for the smaller of `a_stick` and the stress that equals the limit of a lane. Limits have no junctions.
struct LaneSearch {
  StressLimit limit;
  FrictionHeating heating;
  double a_stick;  // [Pa]
  double guess;    // starting stress of the search  [Pa]
  double stress;   // the answer  [Pa]
};

// Makes the searches of the lanes `wanted`, whose limits differ only in pressure, material at this pressure, and
// offset. Returns the lanes whose answer is unique and was found.
std::uint32_t wide_stress(LaneSearch (&searches)[kLanes], std::uint32_t wanted);

}  // namespace shearbus::physics
