// Stress and slip of all lanes of a tile at once (METHODS.md, "Arithmetic"), for models whose friction law and whose
// flow law's softening have a form for registers. A lane with a rarer answer is left to InterfaceStep.
#pragma once

#include <cstdint>
#include <type_traits>
#include <variant>

#include "server/physics/interface/friction_form.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

// Whether the kernel has the softening of this flow law. Closed by default: another law takes the step lane by lane.
template <class Law>
inline constexpr bool kHasWideSoftening = std::is_same_v<Law, SteinbergCochranGuinan>;

// The interfaces of the lanes of a tile.
struct WideInterface {
  WideInterface(const Problem& problem, const TileInputs& tile, const LaneMaterials& materials, double dt,
                const double* committed);

  // Whether the kernels have all forms of the model's interface.
  bool has_forms() const {
    return yields_finitely && !std::holds_alternative<NoForm>(friction) &&
           !(junctions.options != nullptr && std::holds_alternative<FallsWithSlip>(friction));
  }

  const TileInputs& inputs;
  const LaneMaterials& soft_at;
  FrictionForm friction;
  double tresca;                  // shear strength of an interface without junctions, yield strength / sqrt(3)  [Pa]
  bool yields_finitely;           // the strength is finite, and its softening has a form
  Junctions junctions;            // without their strain
  const double* junction_strain;  // plastic strain of the junctions before the step; unused without junctions
  const double* stress_before;    // stress before the step  [Pa]
};

// What the steps of the lanes of a tile have in common.
struct WideStep {
  WideInterface interface;
  double heat_partition;
  double dt;  // length of the whole step
};
// A step of first order, or a stage of one of second order (stages.cpp).
struct WideStage {
  const double* T_ad;  // interface temperature without the heat flux of this stage  [K]
  double B0;           // rise of T0 per heat flux of this stage  [K m2/W]
  double dt;           // length of the stage
};

// The answers of the solved lanes, as LaneStep has them. The flux of all other lanes is 0.
struct WideAnswer {
  alignas(64) double stress[kLanes];
  alignas(64) double slip[kLanes];
  alignas(64) double jump_new[kLanes];
  alignas(64) double flux[kLanes];
  alignas(64) double heat[kLanes];  // friction heat of the step  [J/m2]
  alignas(64) double regime[kLanes];
  alignas(64) double junction_strain[kLanes];  // only with junctions
  std::uint32_t suspects;                      // solved lanes that may change suddenly; all others do not
};

// Solves the active lanes and returns those whose answer is unique and was found. The answer of a lane depends on this
// lane alone.
std::uint32_t wide_slip(const WideStep& step, const WideStage& whole, WideAnswer& answer);

// Writes the answers of the lanes `found` to the tile, except the states and outputs that follow from the temperatures.
void write_answer(const Problem& problem, const WideAnswer& answer, std::uint32_t found, double* trial,
                  TileOutputs& outputs);

// Largest accepted |stress of a sliding interface - its limit| of a second stage, relative to the stress.
inline constexpr double kMet = 1e-9;

// The lanes of which a stage has the answer: they are open, at rest, or slide. The other active lanes take backward
// Euler, except those whose search the kernels leave.
struct StageLanes {
  std::uint32_t solved = 0;
  std::uint32_t resting = 0;  // those of the solved lanes that are at rest throughout the step
  std::uint32_t left = 0;
};
// Stress along the direction of the jump, and heat flux, of the first stage; 0 of lanes without an answer.
struct StageAnswer {
  alignas(64) double stress[kLanes];
  alignas(64) double flux[kLanes];
};
StageLanes wide_first_stage(const WideStep& step, const WideStage& stage, StageAnswer& answer);
StageLanes wide_second_stage(const WideStep& step, const WideStage& stage, const StageAnswer& early,
                             const StageLanes& before, WideAnswer& answer);

}  // namespace shearbus::physics
