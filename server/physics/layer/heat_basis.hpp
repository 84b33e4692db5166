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
  // Factor of each mode in a step of dt: that of backward Euler, 1 / (1 + rate dt), or the exact one, exp(-rate dt).
  std::vector<double> decay(double dt, bool exact) const;

  // The temperature of vertex i is the sum over modes k of amplitude_k shape_ki; the largest |shape_ki| of a mode is 1.
  // Decay rates, ascending  [1/s]. The first is 0: the mean temperature is conserved, or a held end keeps its own. If
  // both ends are held the second is 0, too.
  std::vector<double> rate;
  std::vector<double> shape;         // value of each mode at each vertex, [mode][vertex]
  std::vector<double> projection;    // [mode][vertex]: amplitude_k = sum over vertices of projection_ki T_i
  std::vector<double> at_interface;  // shape of each mode at z = 0
  std::vector<double> soft_heat;     // heat in the soft body per amplitude of each mode  [J/(m2 K)]
  std::vector<double> hard_heat;     // the same of the hard body
  bool holds_ends;                   // an end keeps its temperature, so that modes lose net heat
  bool exact_in_time = false;        // decay() is exact for all steps
  // Heat per amplitude of the first mode; without held ends the other modes have no net heat  [J/(m2 K)].
  double heat = 0.0;

 private:
  void add_mode(const HeatGrid& grid, const Material& soft, const Material& hard, double decay_rate,
                const std::vector<double>& u, const std::vector<double>& of_profile);
  void add_steady_modes(const HeatGrid& grid, const Material& soft, const Material& hard,
                        const std::vector<double>& steady);
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
