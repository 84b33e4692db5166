// Eigenmodes of the discrete heat equation without flux (METHODS.md, sleep). A step without friction multiplies the
// amplitude of each mode by a factor, and modes that have decayed are dropped; the others are called live. The scheme
// is that of HeatOperator in other coordinates.
#pragma once

#include <cstddef>
#include <vector>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/layer/lanes.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

struct HeatBasis {
  HeatBasis(const HeatGrid& grid, const Material& soft, const Material& hard);

  int num_modes() const { return static_cast<int>(rate.size()); }
  // Factor of each mode in a backward Euler step of dt: 1 / (1 + rate dt).
  std::vector<double> decay(double dt) const;

  // The temperature of vertex i is the sum over modes k of amplitude_k shape_ki; the largest |shape_ki| of a mode is 1.
  std::vector<double> rate;          // decay rates  [1/s], ascending; the first is 0: the mean temperature is conserved
  std::vector<double> shape;         // value of each mode at each vertex, [mode][vertex]
  std::vector<double> projection;    // [mode][vertex]: amplitude_k = sum over vertices of projection_ki T_i
  std::vector<double> at_interface;  // shape of each mode at z = 0
  std::vector<double> soft_heat;     // heat in the soft body per amplitude of each mode  [J/(m2 K)]
  double heat = 0.0;                 // heat per amplitude of the first mode; other modes have no net heat  [J/(m2 K)]
};

// Replaces the temperatures of one lane by amplitudes of the modes, [row][lane]. Returns the number of leading modes
// that have not decayed; the amplitudes of the others are 0.
int to_modes(const HeatBasis& basis, int lane, double* rows);
// Computes temperatures from amplitudes; `amplitudes` and `temperature` must not overlap.
void to_profile(const HeatBasis& basis, int num_live, int lane, const double* amplitudes, double* temperature);

// Computes T0 of all lanes after a step without flux. `num_live`: the largest number of live modes in any lane.
void interface_later(const HeatBasis& basis, const double* decay, int num_live, const double* amplitudes,
                     double (&T0)[kLanes]);
// Writes the amplitudes of all modes after a step without flux, for all lanes.
void decay_modes(const double* decay, int num_live, int num_modes, const double* before, double* after);

// Number of live modes of a lane after a step; sets the amplitudes of modes that have decayed to 0.
int still_living(int num_live, int lane, double* amplitudes);

}  // namespace shearbus::physics
