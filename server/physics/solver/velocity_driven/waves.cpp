#include "server/physics/solver/velocity_driven/waves.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>

#include "server/physics/material/elementary.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/model.hpp"
#include "server/physics/solver/scratch.hpp"
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
constexpr double kUnknown = -1.0;        // stands for an x that is not known

// Of the search of one lane.
constexpr double kConvergedAlone = 1e-11;        // Newton's method ends with a step below this fraction of the scale
constexpr double kLastDigits = 4.0 * kRounding;  // the same along secants, whose steps fall short of the minimum
constexpr double kUnfelt = 1e-14;                // temperature rise without effect on the strength, relative to T_melt
// Line search. A step of the velocities may end beyond the minimum of the energy if the slope of the energy there is at
// most this fraction of the slope at the start of the step (without signs; slope: derivative in Newton's direction).
constexpr double kOvershoot = 0.5;
// A shortened step may end before the minimum of the energy if the slope there is at most this fraction of the first.
constexpr double kUndershoot = 0.5;
// A step must lower the energy by at least half this fraction of (length of the step) * (slope of the energy at its
// start).
constexpr double kLeastDescent = 0.25;
// Share of secants in the slopes of a step of the line search: the least, and its factors after a step that was cut and
// after one that was not.
constexpr double kLeastSecant = 1e-4, kMoreSecant = 10.0, kLessSecant = 0.3;
constexpr int kBisections = 30;          // of a step of the line search that secants take the place of if it needs more
constexpr int kQuickSteps = 20;          // of search() at one heat flux, which takes secants where it needs more
constexpr int kGuardedSteps = 400;       // largest number of Newton steps of search() at each heat flux that it tries
constexpr int kMostGuardedSteps = 4000;  // the same if search() is repeated because its first result was not balanced
constexpr double kSurelyBalanced = 1e-6;  // largest accepted residual of the momentum balance, relative to the stresses
// Largest accepted residual due to rounding, in units of the stress that one ulp of the largest velocity causes.
constexpr double kUlps = 1e4;

}  // namespace

// What the lanes of a tile share. A trial stress is returned by the law of Steinberg, Cochran and Guinan (waves_return.hpp)
// in the unknown x = beta dep / (1 + beta ep):
//   s = min(strength (1 + x)^n, ceiling) g(P, T),   strength = Y0 (1 + beta ep)^n / sqrt(3),   ceiling = Y_max / sqrt(3).
struct WaveTile {
  const WaveStep& step;
  std::ptrdiff_t num_cells;
  const double *gain, *inertia;  // [vertex], [cell]: trial stress per velocity difference, stress difference per
                                 // change of velocity  [Pa s/m]
  double exponent, ceiling, hT;  // n; largest strength in shear [Pa]; coefficient of -(T - 300 K) in g  [1/K]
  double per_kappa, yield, beta, velocity_per_stress;
  alignas(64) double T_melt[kLanes];   // melting temperature at the pressure of each lane  [K]
  alignas(64) double bracket[kLanes];  // bracket of the softening g at T = 0 K: 1 + gP P + 300 hT
};

// Rows of the iteration, [vertex or cell][lane].
struct WaveRows {
  double *strength, *compliance, *x, *stress, *velocity, *stiffness, *softening, *direction, *carry, *coupling, *before;
  WaveAnswer& answer;
  double trial_at_interface[kLanes];
  std::uint32_t held = 0;  // lanes with the friction limit at z = 0
};
inline constexpr std::size_t kRows = 11;

}  // namespace shearbus::physics

#define SHEARBUS_KERNELS "server/physics/solver/velocity_driven/waves_kernel.hpp"
#include "server/physics/layer/each_register.hpp"

namespace shearbus::physics {
namespace {

// The search of one lane: Newton's method with a line search, and the guarded search where that does not converge.
class WaveSearch : private one::WaveLanes {
 public:
  // `soft`: the material at the pressure.
  WaveSearch(const WaveTile& tile, WaveRows& rows, const Material& soft, int lane)
      : WaveLanes(tile, rows, lane),
        has_form_(properties_of(soft.flow_law).has_wave_return),
        by_law_(soft, step_.pressure[lane], step_.dt),
        by_law_near_(soft, step_.pressure[lane], step_.dt, give_near_),
        by_law_far_(soft, step_.pressure[lane], step_.dt, give_far_) {}

  // Returns whether the lane has an answer.
  bool solve() {
    start();
    bool found = descend({}, step_.most_steps_alone, false);
    if (!found) {
      search(kGuardedSteps);
      if (!balanced()) {
        evaluations_left_ = kWaveEvaluations;
        search(kMostGuardedSteps);
      }
      found = (evaluations_left_ > 0 || step_.forced) && balanced();
    }
    if (found) write(true, evaluations_);
    rows_.answer.evaluations[lane_] = evaluations_;
    return found;
  }

 private:
  double residual(std::ptrdiff_t c) const {  // residual of the balance of momentum  [Pa]
    return at(rows_.stress, c + 1) - at(rows_.stress, c) -
           tile_.inertia[c] * (at(rows_.velocity, c) - at(step_.velocity, c));
  }

  // Evaluates stresses and slopes at the iterate, for the given heat flux q or else for the heat flux of the stress at
  // z = 0.
  void evaluate(std::optional<double> given) {
    --evaluations_left_;
    evaluations_ += 1.0;
    const auto return_of = [&](std::ptrdiff_t i, double trial, double T) {
      if (has_form_) return return_by_form(i, trial, T);
      const LawReturn& by_law = i == 0 ? by_law_near_ : i == tile_.num_cells ? by_law_far_ : by_law_;
      const ReturnedStress found = by_law.at(at(step_.strain, i), std::abs(trial), T, 0.0);
      return one::Returned{std::copysign(found.stress, trial), found.slope, std::copysign(1.0, trial) * found.softening,
                           0.0};
    };
    const double trial = trial_at_interface();
    if (!given) {
      const Heating heating = heating_under(trial);
      // The strength falls with the heat of the stress, so there is one root, below melting if T_ad is.
      const ReturnedStress found = by_law_near_.at(at(step_.strain, 0), std::abs(trial), at(step_.T_ad, 0),
                                                   heating.per_stress * step_.response[0]);
      carry(trial, heating, found.stress, found.slope);
      return return_vertices(1, return_of);
    }
    flux_ = *given;
    flux_slope_ = 0.0;
    return_vertices(0, return_of);
    held_ = std::abs(at(rows_.stress, 0)) > step_.coulomb[lane_];
    if (!held_) return;
    put(std::copysign(step_.coulomb[lane_], trial), rows_.stress, 0);
    put(0.0, rows_.stiffness, 0);
  }

  // Slope of the energy (see search()) along Newton's direction.
  double slope() const {
    double slope = 0.0;
    for (std::ptrdiff_t c = 0; c < tile_.num_cells; ++c) slope -= at(rows_.direction, c) * residual(c);
    return slope;
  }
  // The same after the fraction `part` of the step.
  double slope_after(double part, std::optional<double> flux) {
    for (std::ptrdiff_t c = 0; c < tile_.num_cells; ++c)
      put(at(rows_.before, c) + part * at(rows_.direction, c), rows_.velocity, c);
    evaluate(flux);
    return slope();
  }

  // Moves the slopes towards those of lines through 0. With the latter a step is the minimum of an energy that is nowhere
  // below that of the layer, so that it descends in full. Newton's own steps hardly move layers that flow under one stress
  // and weigh little, since whole parts of them are free to move.
  void mix_secants(double share) {
    double before = 0.0;
    for (std::ptrdiff_t i = 0; i <= tile_.num_cells; ++i) {
      const double v = velocity_behind(i), trial = at(step_.stress, i) + gain(i) * (v - before);
      before = v;
      const double line = trial != 0.0 ? std::abs(at(rows_.stress, i) / trial) : 1.0;
      put(at(rows_.stiffness, i) + share * (line * gain(i) - at(rows_.stiffness, i)), rows_.stiffness, i);
    }
  }

  // Newton's method with a line search; returns whether it converged. The slope of the energy increases along Newton's
  // direction, so bisection finds where it is small. With `surely` a step beyond the minimum of the energy is accepted
  // only if two slopes, at its middle and at its end, prove that the energy falls.
  bool descend(std::optional<double> flux, int max_steps, bool surely) {
    evaluate(flux);
    double secant = 0.0;  // share of secants in the slopes of the next step
    for (int iteration = 0; iteration < max_steps && evaluations_left_ > 0; ++iteration) {
      if (secant > 0.0) mix_secants(secant);
      const Size size = newton_direction();
      if (surely && iteration >= kQuickSteps) stalled_ = true;
      if (!std::isfinite(size.step)) return false;
      const double scale = size.velocity + size.stress * tile_.velocity_per_stress;
      const bool last = secant == 0.0 ? size.step <= kConvergedAlone * scale + kNothing
                                      : stalled_ && size.step <= kLastDigits * scale;
      for (std::ptrdiff_t c = 0; c < tile_.num_cells; ++c) put(at(rows_.velocity, c), rows_.before, c);
      const double slope_0 = slope();
      double slope = slope_after(1.0, flux);
      if (last) return true;
      // The line search needs a direction along which the energy falls. Where the heating by the stress is solved
      // along with it, the balance is not the gradient of an energy; then the whole Newton step may be taken.
      double lo = 0.0;
      double hi = 1.0;
      double part = 1.0;
      int k = 0;
      for (; k < kBisections && slope_0 < 0.0; ++k) {
        bool too_far = slope > -kOvershoot * slope_0;
        if (surely && slope > 0.0 && !too_far) {
          too_far = slope_after(0.5 * part, flux) + slope > kLeastDescent * slope_0;
          slope_after(part, flux);
        }
        if (!too_far && (part == 1.0 || slope >= kUndershoot * slope_0)) break;
        (slope > 0.0 ? hi : lo) = part;
        part = 0.5 * (lo + hi);
        slope = slope_after(part, flux);
      }
      if (k == kBisections) {  // no shorter step is tried
        stalled_ = true;
        if (!surely) return false;
        slope_after(lo, flux);  // the energy falls until there
      }
      if (!surely || !(step_.forced || stalled_)) continue;
      if (part < 1.0)
        secant = std::clamp(kMoreSecant * secant, kLeastSecant, 1.0);
      else
        secant = secant > kLeastSecant ? kLessSecant * secant : 0.0;
    }
    return false;
  }

  // Solves the step if Newton's method alone has failed: bisects the heat flux q. At a given q the step minimises the
  // convex energy
  //   E(v) = sum over cells of rho width/2 (v - v_old)^2
  //        + sum over vertices of weight/G0 times the integral of R over the trial stress,
  // whose gradient is -dt residual: descend() lowers this energy from any start. Between q = 0 and the q that melts
  // z = 0 the function q - heat_share * max(s[0] [V], 0) changes sign.
  void search(int steps) {
    rows_.answer.guarded |= 1u << lane_;
    const double share = step_.heat_share * jump_;
    double lo = 0.0;
    double hi = std::max(0.0, (T_melt_ - at(step_.T_ad, 0)) / step_.response[0]);
    for (std::ptrdiff_t c = 0; c < tile_.num_cells; ++c) put(at(step_.velocity, c), rows_.velocity, c);
    descend(0.0, steps, true);
    const auto made = [&] { return share * at(rows_.stress, 0); };  // heat flux q that the stress at z = 0 causes
    const double unfelt = kUnfelt * T_melt_ / step_.response[0];
    const bool heats = made() > unfelt;
    while (heats && hi - lo > unfelt && evaluations_left_ > 0) {
      const double flux = 0.5 * (lo + hi);
      descend(flux, steps, true);
      (made() > flux ? lo : hi) = flux;
    }
    evaluate({});  // makes q and the stress at z = 0 consistent to the last digit
  }

  // Whether the balance of momentum holds in every cell. With steps of microseconds and cells of nanometres, far from
  // any real problem, Newton's method may reach its largest number of steps without a solution.
  bool balanced() {
    const Size largest = newton_direction();
    const double ulp = kRounding * largest.velocity;
    for (std::ptrdiff_t c = 0; c < tile_.num_cells; ++c) {
      const double accepted = kSurelyBalanced * (largest.stress + kLeastStress + tile_.inertia[c] * largest.velocity) +
                              kUlps * ulp * (gain(c) + gain(c + 1));
      if (!(std::abs(residual(c)) <= accepted)) return false;
    }
    return true;
  }

  bool has_form_;  // the law is that of WaveTile
  LawReturn by_law_, by_law_near_, by_law_far_;
  // Whether a line search has stalled at rounding, or is likely to: work that heats in place asks for the waves at
  // temperatures next to melting.
  bool stalled_ = step_.heats_in_place;
  int evaluations_left_ = kWaveEvaluations;
  double evaluations_ = 0.0;
};

}  // namespace

std::uint32_t advance_waves(const WaveStep& step, std::uint32_t lanes, WaveAnswer& answer) {
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
  const double kappa = kSqrt3 * soft.shear_modulus;  // stress per plastic strain  [Pa]
  WaveTile tile{.step = step,
                .num_cells = grid.num_cells(),
                .gain = gain,
                .inertia = inertia,
                .exponent = soft.hardening_exponent,
                .ceiling = std::min(soft.yield_strength_max / kSqrt3, kUnlimited),
                .hT = soft.temperature_coefficient,
                .per_kappa = 1.0 / kappa,
                .yield = soft.yield_strength / kSqrt3,
                .beta = soft.hardening_coefficient,
                .velocity_per_stress = velocity_per_stress(soft, grid, step.dt)};
  for (const int l : lanes_of(lanes)) {
    const Material pressed = at_pressure(soft, step.pressure[l]);
    tile.T_melt[l] = pressed.melting_temperature;
    tile.bracket[l] = SteinbergCochranGuinan::bracket_at(pressed, step.pressure[l]);
  }
  std::size_t next = 0;
  const auto rows_of = [&] { return memory + next++ * kLanes * vertices; };
  WaveRows rows{.strength = rows_of(),
                .compliance = rows_of(),
                .x = rows_of(),
                .stress = rows_of(),
                .velocity = rows_of(),
                .stiffness = rows_of(),
                .softening = rows_of(),
                .direction = rows_of(),
                .carry = rows_of(),
                .coupling = rows_of(),
                .before = rows_of(),
                .answer = answer};
  answer.guarded = 0;
  std::uint32_t solved =
      properties_of(soft.flow_law).has_wave_return ? SHEARBUS_CALL(solve_waves, tile, rows, lanes) : 0;
  for (const int l : lanes_of(lanes & ~solved)) {
    if (WaveSearch(tile, rows, at_pressure(soft, step.pressure[l]), l).solve()) solved |= 1u << l;
  }
  // While the friction limit holds the stress at z = 0 the vertex there flows by as much as this stress allows, DLP (48);
  // the rest of its strain is slip of the interface.
  for (const int l : lanes_of(solved)) {
    answer.interface_slip[l] = 0.0;
    if (!contains(rows.held, l)) continue;
    const double trial = rows.trial_at_interface[l], own_kappa = kappa / step.give_near[l];
    const double left = std::abs(trial) - step.coulomb[l], T0 = step.T_ad[l] + answer.flux[l] * step.response[0];
    const double flow = LawReturn(at_pressure(soft, step.pressure[l]), step.pressure[l], step.dt)
                            .strain_under(step.coulomb[l], step.strain[l], T0, left / own_kappa);
    const double slip = std::max(0.0, left - own_kappa * flow) / (gain[0] / step.give_near[l]);
    step.strain[l] += flow;
    answer.slip_along[std::signbit(trial)][l] += kSqrt3 * grid.weight[0] * flow + slip * step.dt;
    answer.interface_slip[l] = std::copysign(slip, trial);
  }
  return solved;
}

}  // namespace shearbus::physics
