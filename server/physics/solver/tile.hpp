// Inputs and answers of one step of a tile (layer/lanes.hpp). states.hpp lists the states of a tile between steps.
#pragma once

#include <cstddef>
#include <cstdint>

#include "server/physics/interface/search_effort.hpp"
#include "server/physics/layer/lanes.hpp"

namespace shearbus::physics {
// From shearbus/v1/downscale.proto, which explains them, by print_contract.py: regimes and outcomes
enum class Regime : std::uint8_t { kOpen = 0, kStick = 1, kCoulomb = 2, kTresca = 3, kMelting = 4 };

// Bits of a lane's outcome; 0 is a plain success.
inline constexpr std::uint8_t kSubstepped = 1;
inline constexpr std::uint8_t kMultipleRoots = 2;
inline constexpr std::uint8_t kOutsideDomain = 4;
inline constexpr std::uint8_t kSudden = 8;
inline constexpr std::uint8_t kOverBudget = 16;
inline constexpr std::uint8_t kAsleep = 32;
inline constexpr std::uint8_t kFirstOrder = 64;
inline constexpr std::uint8_t kFailed = 128;
// print_contract.py: end
// The inputs of the host for one step of one tile. Lanes that are not active may hold any finite number: it affects no
// answer. Members `second_` are second tangential components: they are read only if a model has two.
struct TileInputs {
  const double* stress_before = nullptr;  // stress before the step, [kLanes]; null: committed stress  [Pa]
  SearchEffort* effort = nullptr;         // counters of search effort, to which a step adds; null: no counts
  double* work = nullptr;                 // work of each lane, [kLanes], to which a step adds; null: no counts
  std::uint32_t active = 0;               // bit i: lane i takes the step
  bool wants_mean_stress = false;         // whether TileOutputs::mean_shear_stress and mean_far_stress are wanted
  alignas(64) double velocity_jump[kLanes] = {};    // jump [V]; force-driven: jump before the step, at n-1/2  [m/s]
  alignas(64) double pressure[kLanes] = {};         // normal pressure P, compression positive  [Pa]
  alignas(64) double soft_shear_rate[kLanes] = {};  // shear rate of the host's soft zone, for INTERFACE_SLIP  [1/s]
  alignas(64) double stress_soft[kLanes] = {};      // shear stress in the soft body, half a zone from z = 0  [Pa]
  alignas(64) double stress_hard[kLanes] = {};      // shear stress in the hard body, half a zone from z = 0  [Pa]
  alignas(64) double mass_soft[kLanes] = {};        // mass per area of the soft half zone at the interface  [kg/m2]
  alignas(64) double mass_hard[kLanes] = {};        // mass per area of the hard half zone at the interface  [kg/m2]
  // Plastic strain rate Ep_dot of the host's soft zone, signed: the interface sees [V] + sqrt(3) h Ep_dot  [1/s]
  alignas(64) double soft_plastic_strain_rate[kLanes] = {};
  alignas(64) double second_velocity_jump[kLanes] = {};  // second tangential component of velocity_jump  [m/s]
  alignas(64) double second_stress_soft[kLanes] = {};    // second tangential component of stress_soft  [Pa]
  alignas(64) double second_stress_hard[kLanes] = {};    // second tangential component of stress_hard  [Pa]
  // Second tangential component of soft_plastic_strain_rate  [1/s]
  alignas(64) double second_soft_plastic_strain_rate[kLanes] = {};
};

// Answers of one step of one tile. Members `second_` are written only where a model has two tangential components.
struct TileOutputs {
  alignas(64) double shear_stress[kLanes];           // shear stress s                   [Pa]
  alignas(64) double sliding_velocity[kLanes];       // sliding velocity [v]             [m/s]
  alignas(64) double interface_temperature[kLanes];  // interface temperature T0                   [K]
  alignas(64) double velocity_jump_new[kLanes];    // jump [V] after the step; velocity-driven: the imposed jump  [m/s]
  alignas(64) double friction_heat[kLanes];        // heat that entered the conducting bodies in the step   [J/m2]
  alignas(64) double error_estimate[kLanes];       // estimated error of T0, relative to T_melt - T_start  [1]
  alignas(64) double second_shear_stress[kLanes];  // second tangential component of shear_stress  [Pa]
  // Impulse of the shear stress over the step, divided by dt; only if TileInputs::wants_mean_stress  [Pa]
  alignas(64) double mean_shear_stress[kLanes];
  alignas(64) double mean_far_stress[kLanes];           // with inertia: the same at z = h  [Pa]
  alignas(64) double second_mean_shear_stress[kLanes];  // second tangential component of mean_shear_stress  [Pa]
  // The linearised answer; only after Model::linearise() and Model::predict_melting().
  alignas(64) double stress_per_jump[kLanes];      // derivative of shear_stress by velocity_jump  [Pa s/m]
  alignas(64) double stress_per_pressure[kLanes];  // derivative of shear_stress by pressure  [1]
  alignas(64) double time_to_melting[kLanes];      // time after the step to T0 = T_melt at the rate of the step  [s]
  alignas(64) double second_sliding_velocity[kLanes];   // second tangential component of sliding_velocity  [m/s]
  alignas(64) double second_velocity_jump_new[kLanes];  // second tangential component of velocity_jump_new  [m/s]
  alignas(64) double film_thickness[kLanes];            // liquid at the end of the step; only with a melt film  [m]
  Regime regime[kLanes];
  std::uint8_t outcome[kLanes];
};

// Terms of the energy ledger of a step, per area of interface  [J/m2] (MODEL.md, "Energy ledger").
enum class LedgerTerm : std::uint8_t {
  kWork,
  kHeatToSoft,
  kHeatToHard,
  kPlasticWork,
  kStoredSoft,
  kStoredHard,
  kElastic,
  kHeatResidual,
  kEnergyResidual
};
inline constexpr std::size_t kLedgerTerms = 9;

struct TileLedger {
  alignas(64) double term[kLedgerTerms][kLanes] = {};
  double& operator()(LedgerTerm t, int lane) { return term[static_cast<std::size_t>(t)][lane]; }
};

}  // namespace shearbus::physics
