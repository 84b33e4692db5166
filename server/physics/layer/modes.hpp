// Heat without a temperature profile (METHODS.md). A model that needs only T0 needs only the response of T0 to the flux
// q at z = 0,
//   T0(t) = T_start + integral of K(t - x) q(x) dx.
// K is approximated by a sum of decaying exponentials, so a node stores one number per exponential.
#pragma once

#include <vector>

#include "server/physics/layer/grid.hpp"
#include "server/physics/layer/lanes.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

struct ModesOptions {
  double accuracy = 1e-6;        // largest relative error of K from shortest_step to longest_time
  double shortest_step = 1e-10;  // shortest step of the host  [s]
  double longest_time = 1e-4;    // the modes represent the kernel K up to this time  [s]
};

// The heat kernel K(t) of the soft body: sqrt(alpha) / (k sqrt(pi t)) of a half-space; an insulated slab adds image
// sources.
struct HeatKernel {
  HeatKernel(const Material& soft, const GridOptions& layer);

  double at(double t) const;
  double integral(double t) const;       // integral of K from 0 to t, which is the exact response B0  [K m2/W]
  double moment(double t) const;         // first moment of K, the integral of s K(s) from 0 to t  [K m2 s/W]
  bool far_face_unfelt(double t) const;  // whether the image sources are below rounding until t

  double thickness;     // thickness of the slab; infinity: half-space  [m]
  double conductivity;  // conductivity k  [W/(m K)]
  double diffusivity;   // diffusivity alpha  [m2/s]
  double half_space;    // factor of the half-space kernel, K(t) sqrt(t) = sqrt(alpha / pi) / k  [K m2/(W s^(1/2))]
};

// The modes of the heat kernel: K(t) = sum of weight exp(-rate t), all weights positive, for t >= shortest_step /
// kHalvingsCovered. Exactly, K is a sum over a spectrum of decay rates, written here over mu = sqrt(rate): a continuous
// spectrum of constant density for a half-space, discrete lines for a slab. The range of mu is cut into panels, and a
// Gauss rule with positive weights replaces each panel. Points are added to the rules until the measured relative error
// of K is below the requested accuracy.
struct HeatModes {
  static constexpr double kHalvingsCovered = 64.0;  // largest ratio of a step to its shortest substep

  HeatModes(const HeatKernel& kernel, const ModesOptions& options);

  HeatKernel kernel;
  std::vector<double> rate;    // decay rates of the modes  [1/s], ascending; 0: the mean temperature of a slab
  std::vector<double> weight;  // weight of each mode  [K m2/J]
  double error;                // measured largest relative error of K

  // Number of rows of a tile without a profile: the start temperature, then each mode's share of T0, then T0 itself.
  int num_rows() const { return static_cast<int>(rate.size()) + 2; }
};

// The operator of a step of length dt on the modes and on T0. The response to the flux of the step itself uses the
// exact kernel K, because no sum of exponentials approximates K down to t = 0.
//   constant flux:             T0 = T_start + sum of decay u + B0 q, u: share of T0 of each mode before the step
//   flux through two points:   q_early at `early` dt and q at dt, linear in time through both
struct ModeOperator {
  ModeOperator(const HeatModes& modes, double step);
  ModeOperator(const HeatModes& modes, double step, double early);
  // This constructor only allocates the coefficients; fill() computes them.
  ModeOperator(int num_rows, double step);
  void fill(const HeatModes& modes);

  double dt;                       // step length  [s]
  int interface;                   // index of the row of T0
  double response = 0.0;           // B0: response of T0 to q      [K m2/W]
  double early_response = 0.0;     // response of T0 to q_early       [K m2/W]
  std::vector<double> decay;       // factor of a step on each mode, exp(-rate dt)
  std::vector<double> gain;        // response of each mode to q      [K m2/W]
  std::vector<double> early_gain;  // response of each mode to q_early  [K m2/W]; empty if the flux is constant

  const double* layer_response() const { return &response; }
};

// The same operations as in conduction.hpp, for the rows of HeatModes.
void conduct(const ModeOperator& heat, int num_rows, const double* before, double* after);
void conduct_lane(const ModeOperator& heat, int num_rows, int lane, double* rows);
void add_flux(const ModeOperator& heat, int num_rows, const double (&flux)[kLanes], double* rows);
void add_flux_lane(const ModeOperator& heat, int num_rows, int lane, double flux, double* rows);
void add_early_flux_lane(const ModeOperator& heat, int num_rows, int lane, double flux, double* rows);

}  // namespace shearbus::physics
