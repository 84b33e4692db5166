// Plastic flow of the layers of a tile under given stresses (MODEL.md, "Plastic strain"): DLP (42-48), and METHODS.md,
// "Velocity-driven root".
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "server/physics/layer/grid.hpp"
#include "server/physics/material/elementary.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/tile.hpp"

namespace shearbus::physics {

// As std::has_single_bit(), without the call that it costs where the processor may lack the instruction.
constexpr bool is_one_lane(std::uint32_t lanes) {
  return lanes != 0 && (lanes & (lanes - 1)) == 0;
}

// The layers of a tile at the start of a step. Arrays are [vertex][lane].
struct FlowProblem {
  const Material* soft;
  const Grid* grid;
  const double* response;  // response B of the temperature to a unit heat flux at z = 0; one value per vertex  [K m2/W]
  const double* T_ad;      // temperature after the step without friction heat  [K]
  const double* strain;    // plastic strain before the step
  double dt;               // length of the step  [s]
  // Response B_phi to heat released in the layer; if not null, it replaces B.
  const double* spread_response = nullptr;
};

// How well a sum knows the flow of one lane.
struct FlowAccuracy {
  double hot;     // sum that the flow may be a small difference of  [m]
  double slope;   // derivative of the flow by ln(a) at the same flux per stress  [m]
  double digits;  // rounding error of the flow, relative to `slope`
};

// What sums over the layer tell of the flow of one lane under other loads: near the load of a sum, the flow is
//   (a / base)^exponent exp(curvature ln(a / base)^2) (moment[0] + moment[1] w + ... + moment[3] w^3) + constant
// where w is the relative change of the flux q from base_flux.
struct NearbyFlow {
  static constexpr int kTerms = 4;
  double base = 0.0;       // stress  [Pa]; 0: nothing is known of other loads
  double base_flux = 0.0;  // heat flux  [W/m2]
  double exponent = 0.0;
  double curvature = 0.0;
  double moment[kTerms] = {};  // [m]
  double constant = 0.0;       // [m]

  struct Slip {
    double value, by_stress, by_flux;  // integral(dep)  [m], and its derivatives  [m/Pa], [m3/W]
  };
  Slip at(double stress, double flux) const {
    const double w = base_flux > 0.0 ? flux / base_flux - 1.0 : 0.0;
    const double hot = moment[0] + w * (moment[1] + w * (moment[2] + w * moment[3]));
    const double hotter = moment[1] + w * (2.0 * moment[2] + w * (3.0 * moment[3]));
    const double v = stress == base ? 0.0 : logarithm(stress / base);
    const double y = v == 0.0 ? 1.0 : exponential(v * (exponent + curvature * v));
    return {y * hot + constant, (exponent + 2.0 * curvature * v) * y * hot / stress,
            base_flux > 0.0 ? y * hotter / base_flux : 0.0};
  }
};

// Whether a stress `a` under which the flow was summed meets its balance: the compliance times the plastic slip is
// `left`. The last digits of the flow count only if the flow is at most twice what it
// must be: far above the root, in a vertex that a few more digits would melt, any residual would pass.
inline bool is_balanced(double a, double left, double compliance, double slip, const FlowAccuracy& accuracy) {
  constexpr double kClosed = 1e-11;   // largest accepted residual, relative to what the flow must be
  constexpr double kRounded = 2e-15;  // rounding error of `hot`
  const double flow = compliance * slip;
  double open = kClosed * left + kRounded * (compliance * accuracy.hot);
  if (flow <= 2.0 * left) open += accuracy.digits * (compliance * accuracy.slope + a);
  return std::abs(flow - left) <= open;
}

// Bounds of what lies farther out in the layer, for blocks of vertices. Where even the hottest of the vertices from a
// block on would not yield with the least strain of them, none does, and an expansion ends.
struct FlowBounds {
  static constexpr int kBlocks = 8;
  std::ptrdiff_t rows;                         // number of vertices of each block but the last
  alignas(64) double T_ad[kBlocks][kLanes];    // the highest temperature T_ad of the vertices from the block on  [K]
  alignas(64) double strain[kBlocks][kLanes];  // their least plastic strain
  alignas(64) double spread[kBlocks][kLanes];  // their largest response B_phi, if heat is released in the layer
};

// The metal at z = 0 before a step: its strength H, if the law is separable, at the rate 0  [Pa]; its softening g.
struct FirstVertices {
  alignas(64) double strength[kLanes];
  alignas(64) double g[kLanes];
};
// Finds those of `lanes`. `T`, `strain`: rows of the vertices at z = 0, [lane].
void find_first_vertices(const LaneMaterials& soft_at, std::uint32_t lanes, const double* pressure, const double* T,
                         const double* strain, FirstVertices& found);

// The flow of laws whose strain increment is explicit. One sum over the layer gives the flow under a stress and, as a
// series, the flow under stresses nearby. Under the stress a = base (1 + u) and a flux of 1 + w times that at the base
// it is, if the same vertices yield,
//   (1 + u)^exponent (moment[0] + moment[1] w + moment[2] w^2 + moment[3] w^3) + a constant
struct ExpandedLoads {
  alignas(64) double base[kLanes];                        // stress about which the flow is expanded  [Pa]
  alignas(64) double base_heating[kLanes];                // `heating` about which the flow is expanded  [m/s]
  alignas(64) double moment[NearbyFlow::kTerms][kLanes];  // [m]
  alignas(64) double u[kLanes], y[kLanes];                // a / base - 1 and (1 + u)^exponent
  alignas(64) double w[kLanes];            // q / (flux at the base) - 1; u if `heating` is that of the base
  alignas(64) double steepest[kLanes];     // how fast the fastest of the vertices' expansions grows with w
  alignas(64) double origin[kLanes];       // stress about which `limit` is known  [Pa]
  alignas(64) double origin_flux[kLanes];  // heat flux about which `limit` is known  [W/m2]
  alignas(64) double limit[kLanes];        // number of vertices from z = 0 to the last block with one that can yield
  FlowBounds bounds;
};

// The flow of laws whose strain increment is searched for. The search of a vertex starts from the root of its last sum,
// moved along its slope, or from those of its neighbours towards z = 0.
struct SearchedLoads {
  alignas(64) double last_stress[kLanes];               // stress of the last sum  [Pa]
  alignas(64) double last_flux[kLanes];                 // heat flux of the last sum  [W/m2]
  alignas(64) double stress[kLanes], log_slip[kLanes];  // stress [Pa] and logarithm of the slip of nearby()
  bool summed;                                          // false: no sum has been made
};

// Sums of the flow over the layers of a tile in one step. The answer of a lane depends on the loads of that lane since
// the start of the sums alone.
class LayerFlow {
 public:
  static constexpr int kTerms = 4;  // numbers kept of each vertex: an expansion; or root, dep, its slope, rest

  static std::size_t size_of_rows(const Grid& grid) {
    return static_cast<std::size_t>(grid.num_vertices()) * kTerms * kLanes;
  }

  // `rows`: an array of the size size_of_rows(), of which nothing is read at first.
  LayerFlow(const FlowProblem& layers, double* rows);

  // Loads a lane with the stress magnitude a, which heats by the flux `heat_per_stress` a. `at_pressure`: the material
  // at the pressure P.
  void load(int lane, const Material& at_pressure, double pressure, double a, double heat_per_stress) {
    pressed[lane] = 1.0 + at_pressure.pressure_coefficient * pressure;
    T_melt[lane] = at_pressure.melting_temperature;
    load(lane, a, heat_per_stress);
  }
  void load(int lane, double a, double heat_per_stress) { stress[lane] = a, heating[lane] = heat_per_stress; }
  // Forgets what the sums of a lane have shown, whose spread_response has changed.
  void forget(int lane);

  // Sums the flow of a lane, if `lanes` is this lane, or else of all lanes, under their loads, and writes the new plastic
  // strain of all their vertices. The lanes of the first sum are those of all others.
  void sum(std::uint32_t lanes, double* strain_new);

  FlowAccuracy accuracy(int lane) const {
    constexpr double kExplicitDigits = 2e-15, kSearchedDigits = 1e-14;
    if (is_explicit) return {expanded.moment[0][lane], slope[lane], kExplicitDigits};
    return {slip[lane], slope[lane], kSearchedDigits};
  }
  // What the last sums tell of the flow of a lane under loads nearby.
  NearbyFlow nearby(int lane) { return is_explicit ? nearby_explicit(lane) : nearby_searched(lane); }
  // The stress of each lane of `lanes` at which the balance a + compliance slip = a_trial is met by the flow nearby, with
  // the flux per stress of the load; -1 where that is not known well enough to tell.
  void find_roots(std::uint32_t lanes, double compliance, const double (&a_trial)[kLanes], double (&root)[kLanes]);

  // The results of the last sum.
  alignas(64) double slip[kLanes] = {};   // integral of the strain increment dep over the layer  [m]
  alignas(64) double slope[kLanes] = {};  // derivative of `slip` by ln(a) at the same flux per stress  [m]

  // For the kernels (layer_flow_kernel.hpp).
  FlowProblem problem;
  double* rows_of_vertices;                 // what is kept of the vertices, [vertex][term][lane]
  alignas(64) double stress[kLanes] = {};   // magnitude of the stress a  [Pa]
  alignas(64) double heating[kLanes] = {};  // heat flux per stress, q / a  [m/s]
  alignas(64) double pressed[kLanes] = {};  // 1 + gP P
  alignas(64) double T_melt[kLanes] = {};   // melting temperature at the lane's pressure  [K]
  double exponent = 0.0;                    // of the stress in an explicit flow
  bool is_explicit;
  std::uint32_t bounds_known = 0;  // lanes whose expanded.bounds are known, one bit per lane
  ExpandedLoads expanded;
  SearchedLoads searched;

 private:
  NearbyFlow nearby_explicit(int l) const {
    const ExpandedLoads& at = expanded;
    NearbyFlow flow{.base = at.base[l],
                    .base_flux = at.base_heating[l] * at.base[l],
                    .exponent = exponent,
                    .moment = {at.moment[0][l], at.moment[1][l], at.moment[2][l], at.moment[3][l]}};
    const double w = at.w[l];
    const double* m = flow.moment;
    flow.constant = slip[l] - at.y[l] * (m[0] + w * (m[1] + w * (m[2] + w * m[3])));
    return flow;
  }
  NearbyFlow nearby_searched(int lane);
};

}  // namespace shearbus::physics
