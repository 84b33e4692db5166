#include "server/physics/solver/velocity_driven/waves_wide.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "server/physics/material/elementary.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/model.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/velocity_driven/waves.hpp"
#include "server/physics/solver/velocity_driven/waves_return.hpp"

namespace shearbus::physics {
namespace {

constexpr double kMelting = SteinbergCochranGuinan::kMeltingFactor;
constexpr double kConverged = 1e-12;  // Newton's method ends before a step below this fraction of the scale
constexpr double kBalanced = 1e-11;   // and no residual of the momentum balance exceeds this share of the stresses
constexpr double kLeastStress = 1e6;  // added to them, because close to melting all stresses vanish  [Pa]
constexpr double kReturned = 1e-11;   // the same of the return at z = 0, relative to its stress
// and its stress is the yield stress to this share: within rounding of T_melt a step is short far from the root
constexpr double kSameStress = 1e-6;
constexpr double kRounding = std::numeric_limits<double>::epsilon();
// A return ends with a step r (1 + x) whose third power, which is what it leaves, is too small for the strain to show:
// the strain magnifies an error of the stress by the stiffness.
constexpr double kLocallyConverged = 1e-12;
constexpr double kNear = 0.25;                                     // shorter steps of x take the curvature along
constexpr double kNothing = 1e-14;                                 // a change of velocity so small has no effect  [m/s]
constexpr double kFarthestStep = 1e12;                             // a longer step of the velocities is no step  [m/s]
constexpr double kLeastToMelting = 1e-10, kLeastBracket = 1e-290;  // smallest T_melt - T [K], smallest bracket
constexpr double kLeastReturn = 1e-200;  // a smaller stress at z = 0 is left to the general search  [Pa]
constexpr double kUnlimited = 1e300;     // stands for no bound  [Pa]
constexpr int kInterfaceSteps = 40;      // iterations of the return at z = 0, likewise
constexpr int kInterfaceNewton = 12;     // those of them after which a step that is not half the one before bisects
constexpr int kReturnSteps = 60;         // iterations of the return of a vertex; 1 to 3 are usual

// The vertex at z = 0 while the friction limit holds its stress: it flows by as much as this stress allows, DLP (48); the
// rest of its strain is slip of the interface.
struct HeldVertex {
  double strain_growth;  // growth of its plastic strain
  double left;           // trial stress that is left to the slip  [Pa]
};
// `trial`: magnitude of the trial stress; `yield`: yield stress in shear before the step; `kappa`: sqrt(3) G0.
HeldVertex flow_under_friction(double trial, double coulomb, double yield, double compliance, double kappa,
                               double exponent) {
  const double left = trial - coulomb;
  double flow = 0.0;
  if (coulomb > yield) {
    const double x = exponential_minus_1(logarithm(coulomb / yield) / exponent);
    flow = std::min(compliance > 0.0 ? x / (compliance * kappa) : 0.0, left / kappa);
  }
  return {flow, left - kappa * flow};
}

}  // namespace

// What the lanes of a tile share, and their inputs and states (WideWaveStep).
struct WaveTile {
  std::ptrdiff_t num_cells;
  int most_steps;
  bool tries_limit;
  const double *gain, *inertia, *response, *weight;
  ReturnLaw law;
  double per_kappa, yield, beta, heat_share, velocity_per_stress;
  const double *T_melt, *bracket, *jump, *coulomb, *give_near, *give_far;
  const double *T_ad, *guess;
  double *strain, *stress, *velocity;
};

// Rows of the iteration, [vertex or cell][lane].
struct WaveRows {
  double *strength, *compliance, *x, *stress, *velocity, *stiffness, *softening, *constant, *carry, *coupling;
  double *flux, *slip_along[2], *iterations, *trial_at_interface;
  std::uint32_t held = 0;  // lanes with the friction limit at z = 0
};
inline constexpr std::size_t kRows = 10;

}  // namespace shearbus::physics

#define SHEARBUS_KERNELS "server/physics/solver/velocity_driven/waves_kernel.hpp"
#include "server/physics/layer/each_register.hpp"

namespace shearbus::physics {

ReturnLaw return_law_of(const Material& soft) {
  return {soft.hardening_exponent, std::min(soft.yield_strength_max / kSqrt3, kUnlimited),
          soft.temperature_coefficient};
}

void return_to_yield(const ReturnLaw& law, double T_melt, double bracket, int num_vertices, ReturnRows& rows,
                     double* stress) {
  SHEARBUS_CALL(return_to_yield, law, T_melt, bracket, num_vertices, rows, stress);
}

std::uint32_t advance_waves_wide(const WideWaveStep& step, std::uint32_t lanes, WideWaveAnswer& answer) {
  const Material& soft = *step.soft;
  const Grid& grid = *step.grid;
  const std::size_t vertices = static_cast<std::size_t>(grid.num_vertices());
  // The rows, and behind them what depends on the vertex alone.
  double* memory = scratch_tile(Scratch::kFlow, (kRows * kLanes + 2) * vertices);
  double* gain = memory + kRows * kLanes * vertices;
  double* inertia = gain + vertices;
  for (std::size_t i = 0; i < vertices; ++i) {
    gain[i] = soft.shear_modulus * step.dt / grid.weight[i];
    if (i + 1 < vertices) inertia[i] = soft.density * grid.width[i] / step.dt;
  }
  const double kappa = kSqrt3 * soft.shear_modulus;
  const WaveTile tile{.num_cells = grid.num_cells(),
                      .most_steps = step.most_steps,
                      .tries_limit = step.tries_limit,
                      .gain = gain,
                      .inertia = inertia,
                      .response = step.response,
                      .weight = grid.weight.data(),
                      .law = return_law_of(soft),
                      .per_kappa = 1.0 / kappa,
                      .yield = soft.yield_strength / kSqrt3,
                      .beta = soft.hardening_coefficient,
                      .heat_share = step.heat_share,
                      .velocity_per_stress = velocity_per_stress(soft, grid, step.dt),
                      .T_melt = step.T_melt,
                      .bracket = step.bracket,
                      .jump = step.jump,
                      .coulomb = step.coulomb,
                      .give_near = step.give_near,
                      .give_far = step.give_far,
                      .T_ad = step.T_ad,
                      .guess = step.guess != nullptr ? step.guess : step.velocity,
                      .strain = step.strain,
                      .stress = step.stress,
                      .velocity = step.velocity};
  std::size_t next = 0;
  const auto rows_of = [&] { return memory + next++ * kLanes * vertices; };
  double trial_at_interface[kLanes];
  WaveRows rows{.strength = rows_of(),
                .compliance = rows_of(),
                .x = rows_of(),
                .stress = rows_of(),
                .velocity = rows_of(),
                .stiffness = rows_of(),
                .softening = rows_of(),
                .constant = rows_of(),
                .carry = rows_of(),
                .coupling = rows_of(),
                .flux = answer.flux,
                .slip_along = {answer.slip_along[0], answer.slip_along[1]},
                .iterations = answer.iterations,
                .trial_at_interface = trial_at_interface};
  const std::uint32_t solved = SHEARBUS_CALL(solve_waves, tile, rows, lanes);
  for (const int l : lanes_of(solved)) {
    answer.interface_slip[l] = 0.0;
    if (!contains(rows.held, l)) continue;
    const double T = step.T_ad[l] + answer.flux[l] * step.response[0];
    const double g =
        (step.bracket[l] - tile.law.hT * T) * exponential(-kMelting * T / (step.T_melt[l] - T));  // z = 0 is not molten
    const HeldVertex held = flow_under_friction(std::abs(trial_at_interface[l]), step.coulomb[l], rows.strength[l] * g,
                                                rows.compliance[l], kappa / step.give_near[l], tile.law.exponent);
    const bool below = std::signbit(trial_at_interface[l]);
    step.strain[l] += held.strain_growth;
    answer.slip_along[below][l] += kSqrt3 * grid.weight[0] * held.strain_growth;
    answer.interface_slip[l] = held.left / (gain[0] / step.give_near[l]);
  }
  return solved;
}

}  // namespace shearbus::physics
