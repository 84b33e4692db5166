// Heat that no flux enters or leaves, in the modes of its grid: there a step without friction is one product per mode,
// and a mode that has died away is left out. The scheme is HeatOperator's own, only written in other coordinates
// (MODEL.md section 3b).
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
  // What a backward Euler step of dt leaves of each mode.
  std::vector<double> decay(double dt) const;

  // T_i = sum over modes of amplitude_k shape_ki, where the largest |shape_ki| of a mode is 1.
  std::vector<double> rate;          // [1/s], rising; the first is 0: the mean temperature stays
  std::vector<double> shape;         // [mode][vertex]
  std::vector<double> projection;    // [mode][vertex]: amplitude_k = sum over vertices of projection_ki T_i
  std::vector<double> at_interface;  // shape at z = 0
  std::vector<double> soft_heat;     // of an amplitude of 1 K in the soft body  [J/(m2 K)]
  double heat = 0.0;                 // of 1 K of the first; the others hold none in all  [J/(m2 K)]
};

// One lane from temperatures to amplitudes, in place, both [row][lane]. The number of modes that live: the others are
// 0.
int to_modes(const HeatBasis& basis, int lane, double* rows);
// Back again: `amplitudes` and `temperature` may not be the same.
void to_profile(const HeatBasis& basis, int num_live, int lane, const double* amplitudes, double* temperature);

// The lanes' interface temperatures a step later, of which `num_live` are the most modes that live in any.
void interface_later(const HeatBasis& basis, const double* decay, int num_live, const double* amplitudes,
                     double (&T0)[kLanes]);
// And the amplitudes themselves, of all rows.
void decay_modes(const double* decay, int num_live, int num_modes, const double* before, double* after);

// How many modes of a lane still live, of those that did.
int still_living(int num_live, int lane, double* amplitudes);

}  // namespace shearbus::physics
