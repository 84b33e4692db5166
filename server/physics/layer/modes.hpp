// Heat without a temperature profile (METHODS.md). A model that needs only T0 needs only the response of T0 to the flux
// q at z = 0,
//   T0(t) = T_start + integral of K(t - x) q(x) dx.
// K is approximated by a sum of decaying exponentials, so a node stores one number per exponential.
#pragma once

#include <cstddef>
#include <vector>

#include "server/physics/layer/grid.hpp"
#include "server/physics/layer/lanes.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

struct ModesOptions {
  double accuracy = 1e-6;        // largest relative error of the heat kernel K between the two times below
  double shortest_step = 1e-10;  // shortest step of the host  [s]
  double longest_time = 1e-4;    // time up to which the modes represent the kernel K  [s]
};

// The heat kernel K(t) of the soft body: the rise of T0 at the time t after a heat pulse of 1 J/m2 at z = 0. For a
// half-space K = sqrt(alpha) / (k sqrt(pi t)); the kernel of a slab has additional terms, its image sources, which have
// alternating signs if its far face keeps its temperature.
struct HeatKernel {
  HeatKernel(const Material& soft, const GridOptions& layer);

  double at(double t) const;
  double integral(double t) const;  // integral of K from 0 to t: exact rise B0 of T0 by a unit flux  [K m2/W]
  double moment(double t) const;    // first moment of K, the integral of s K(s) from 0 to t  [K m2 s/W]
  double lowest_line() const { return held ? 0.5 : 1.0; }  // of the lines m with rates alpha (m pi / h)^2 of a slab
  bool far_face_unfelt(double t) const;  // whether the image sources of a slab are below rounding until t

  double thickness;     // thickness of the slab; infinity: half-space  [m]
  bool held;            // the far face of the slab keeps its temperature
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
  std::vector<double> rate;    // decay rate of each mode, ascending; rate 0: mean of an insulated slab  [1/s]
  std::vector<double> weight;  // weight of each mode  [K m2/J]
  double error;                // measured largest relative error of K

  // Number of values per node in place of a temperature profile: the start temperature, the part that each mode adds to
  // T0, and T0.
  int num_rows() const { return static_cast<int>(rate.size()) + 2; }
};

// The coefficients of a step of length dt for the modes and for T0. The flux q of the step itself raises T0 by the
// exact kernel K, because no sum of exponentials approximates K down to t = 0. The flux within the step is
//   constant:         T0 = T_start + sum of decay u + B0 q, where u is the part of each mode in T0 before the step
//   linear in time:   q_early at the time `early` dt and q at the end of the step
struct ModeOperator {
  ModeOperator(const HeatModes& modes, double step);
  ModeOperator(const HeatModes& modes, double step, double early);
  // This constructor only allocates the coefficients; fill() computes them.
  ModeOperator(int num_rows, double step);
  void fill(const HeatModes& modes);

  double dt;                       // step length  [s]
  int interface;                   // index of T0 among the rows of a tile
  double response = 0.0;           // rise of T0 per unit of the flux q; B0 if the flux is constant  [K m2/W]
  double early_response = 0.0;     // rise of T0 per unit of the flux q_early  [K m2/W]
  std::vector<double> decay;       // factor by which each mode decays in the step, exp(-rate dt)
  std::vector<double> gain;        // rise of each mode per unit of the flux q  [K m2/W]
  std::vector<double> early_gain;  // rise of each mode per unit of q_early; empty if the flux is constant  [K m2/W]

  const double* layer_response() const { return &response; }
};

// Conduction and heating of a step for nodes that keep modes: the namesakes of the functions for profiles in
// conduction.hpp.
void conduct(const ModeOperator& heat, int num_rows, const double* before, double* after, std::ptrdiff_t next = 0);
void conduct_lane(const ModeOperator& heat, int num_rows, int lane, double* rows);
void add_flux(const ModeOperator& heat, int num_rows, const double (&flux)[kLanes], double* rows);
void add_flux_lane(const ModeOperator& heat, int num_rows, int lane, double flux, double* rows);
// Adds the response to the flux q_early, in all lanes.
void add_early_flux(const ModeOperator& heat, int num_rows, const double (&flux)[kLanes], double* rows);

}  // namespace shearbus::physics
