// A tile: kLanes shear layers side by side, the unit of work of the solvers. Arrays across the layer are
// [vertex][lane], lane fastest, so that the sweep across the layer is sequential and the lanes vectorise. A lane never
// looks at its neighbour: its answer has the same bits whatever the other lanes hold.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "server/physics/interface/search_effort.hpp"

namespace shearbus::physics {

inline constexpr int kLanes = 8;

// A set of lanes, ascending in a loop: bit i stands for lane i.
class LaneSet {
 public:
  class Iterator {
   public:
    constexpr explicit Iterator(std::uint32_t left) : left_(left) {}
    constexpr int operator*() const { return std::countr_zero(left_); }
    constexpr Iterator& operator++() {
      left_ &= left_ - 1;
      return *this;
    }
    constexpr bool operator==(const Iterator&) const = default;

   private:
    std::uint32_t left_;
  };
  constexpr explicit LaneSet(std::uint32_t lanes) : lanes_(lanes & ((1u << kLanes) - 1)) {}
  constexpr Iterator begin() const { return Iterator(lanes_); }
  static constexpr Iterator end() { return Iterator(0); }

 private:
  std::uint32_t lanes_;
};

// `for (const int lane : lanes_of(active))`; the loop walks a copy of `active`.
constexpr LaneSet lanes_of(std::uint32_t active) {
  return LaneSet(active);
}

constexpr bool contains(std::uint32_t lanes, int lane) {
  return (lanes >> lane & 1u) != 0;
}

enum class Regime : std::uint8_t { kOpen = 0, kStick = 1, kCoulomb = 2, kTresca = 3, kMelting = 4 };

// Bits of a lane's outcome; 0 is a plain success.
inline constexpr std::uint8_t kSubstepped = 1;
inline constexpr std::uint8_t kMultipleRoots = 2;
inline constexpr std::uint8_t kOutsideDomain = 4;
inline constexpr std::uint8_t kAsleep = 32;      // at rest: not solved
inline constexpr std::uint8_t kFirstOrder = 64;  // a second-order step left its domain: backward Euler in its place
inline constexpr std::uint8_t kFailed = 128;

// State of one tile: doubles at offsets told by TileLayout; an offset of kAbsent is a part this model does not have.
struct TileLayout {
  static constexpr std::size_t kAbsent = static_cast<std::size_t>(-1);
  std::size_t num_vertices = 0;  // of temperature: the layer's and, for a half-space, those of the soft body behind it
  std::size_t num_hard_vertices = 0;    // of the hard body's temperature, z = 0 apart; none where it does not conduct
  std::size_t num_strain_vertices = 0;  // of plastic strain: the layer's, or none
  std::size_t num_stress_vertices = 1;  // of shear stress: z = 0, or all of the layer's where it has inertia
  std::size_t num_velocity_cells = 0;   // of velocity: the layer's where it has inertia
  std::size_t num_heat_modes = 0;  // rows in place of a profile: start temperature, shares of T0; `temperature` is T0
  std::size_t hard_temperature = kAbsent;  // [num_hard_vertices][kLanes]  K, the outermost first; `temperature` follows
  std::size_t heat_modes = kAbsent;        // [num_heat_modes][kLanes]     K, `temperature` follows
  std::size_t temperature = 0;             // [num_vertices][kLanes]  K
  std::size_t plastic_strain = kAbsent;    // [num_strain_vertices][kLanes]  1
  std::size_t heat_shape = kAbsent;        // [num_strain_vertices][kLanes]  share of the work that heats each vertex  1
  std::size_t shear_stress = 0;            // [num_stress_vertices][kLanes]  Pa, signed
  std::size_t second_stress = kAbsent;     // [kLanes]  Pa, of the second tangential direction
  std::size_t layer_velocity = kAbsent;    // [num_velocity_cells][kLanes]  against the hard body  m/s
  std::size_t regime = 0;                  // [kLanes]  the Regime of the last step, as a double
  std::size_t sticking = kAbsent;          // [kLanes]  1 where the interface ended the last step without slip, else 0
  std::size_t junction_strain = kAbsent;   // [kLanes]  ep_a of the junctions                1
  std::size_t resting = kAbsent;           // [2][kLanes]  steps at rest; while asleep modes that live, else 0
  std::size_t weakest = kAbsent;  // [2][kLanes]  while asleep: K of the hottest vertex; Pa, the least hardened strength
  std::size_t doubles = 0;        // of a tile, a multiple of kLanes

  // Where the temperatures of all that conducts begin: the rows of HeatGrid (of a lane asleep those of HeatBasis), or
  // of HeatModes.
  std::size_t first_temperature() const { return temperature - (num_hard_vertices + num_heat_modes) * kLanes; }
};

// What the host sends for one step of one tile. Lanes that are not active may hold any finite number; they are not read.
// Members `second_` are second tangential components: read only where a model has two.
struct TileInputs {
  const double* stress_before = nullptr;                     // [kLanes], in place of the committed shear stress  [Pa]
  SearchEffort* effort = nullptr;                            // added to where it is given
  std::uint32_t active = 0;                                  // bit i: lane i takes the step
  alignas(64) double velocity_jump[kLanes] = {};             // [V], of n-1/2 when force-driven  [m/s]
  alignas(64) double pressure[kLanes] = {};                  // P, compression positive          [Pa]
  alignas(64) double soft_shear_rate[kLanes] = {};           // of the soft zone (interface_slip)  [1/s]
  alignas(64) double stress_soft[kLanes] = {};               // soft side                        [Pa]
  alignas(64) double stress_hard[kLanes] = {};               // hard side                        [Pa]
  alignas(64) double mass_soft[kLanes] = {};                 // [kg/m2]
  alignas(64) double mass_hard[kLanes] = {};                 // [kg/m2]
  alignas(64) double soft_plastic_strain_rate[kLanes] = {};  // Ep_dot, >= 0 (plastic layer)  [1/s]
  alignas(64) double second_velocity_jump[kLanes] = {};      // [m/s]
  alignas(64) double second_stress_soft[kLanes] = {};        // [Pa]
  alignas(64) double second_stress_hard[kLanes] = {};        // [Pa]
};

// Answers of one step of one tile. Members `second_` are written only where a model has two tangential components.
struct TileOutputs {
  alignas(64) double shear_stress[kLanes];              // s                                [Pa]
  alignas(64) double sliding_velocity[kLanes];          // [v]                              [m/s]
  alignas(64) double interface_temperature[kLanes];     // T0                               [K]
  alignas(64) double velocity_jump_new[kLanes];         // force-driven: [V] at n+1/2       [m/s]
  alignas(64) double friction_heat[kLanes];             // entered the conducting bodies in this step   [J/m2]
  alignas(64) double error_estimate[kLanes];            // of models with a tolerance only: see there   [1]
  alignas(64) double second_shear_stress[kLanes];       // [Pa]
  alignas(64) double second_sliding_velocity[kLanes];   // [m/s]
  alignas(64) double second_velocity_jump_new[kLanes];  // [m/s]
  Regime regime[kLanes];
  std::uint8_t outcome[kLanes];
};

// Where the energy of a step went, per area of interface  [J/m2]. MODEL.md section 7b says what each is.
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
