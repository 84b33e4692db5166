#include "server/physics/solver/velocity_driven/waves.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/velocity_driven/waves_return.hpp"

namespace shearbus::physics {
namespace {

using Row = WaveFields::Row;

constexpr double kConverged = 1e-11;  // Newton's method ends with a step below this fraction of the unknowns' scale
constexpr double kNothing = 1e-14;    // a change of velocity so small has no effect, for any dt and cell  [m/s]
constexpr double kUnfelt = 1e-14;     // temperature rise without effect on the strength, relative to T_melt
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
constexpr int kBisections = 200;         // largest number of bisections of an interval, enough to reach rounding
constexpr int kGuardedSteps = 400;       // largest number of Newton steps of search() at each heat flux that it tries
constexpr int kMostGuardedSteps = 4000;  // the same if search() is repeated because its first result was not balanced
constexpr double kBalanced = 1e-6;       // largest accepted residual of the momentum balance, relative to the stresses
// Added to the largest stress before it is multiplied by kBalanced, because close to melting all stresses vanish  [Pa]
constexpr double kLeastStress = 1e6;
// Largest accepted residual due to rounding, in units of the stress that one ulp of the largest velocity causes.
constexpr double kUlps = 1e4;

class Waves {
 public:
  Waves(const WaveStep& step, WaveFields& fields, int evaluations)
      : step_(step),
        fields_(fields),
        num_cells_(step.grid->num_cells()),
        kappa_(kSqrt3 * step.soft->shear_modulus),
        law_(return_law_of(*step.soft)),
        T_melt_(step.soft->melting_temperature),
        bracket_(SteinbergCochranGuinan::bracket_at(*step.soft, step.pressure)),
        by_law_(*step.soft, step.pressure, step.dt),
        by_law_near_(*step.soft, step.pressure, step.dt, step.give_near),
        by_law_far_(*step.soft, step.pressure, step.dt, step.give_far),
        has_form_(properties_of(step.soft->flow_law).has_wave_return),
        evaluations_(evaluations),
        evaluations_left_(evaluations) {
    const Material& soft = *step.soft;
    const int padded = (num_cells_ / WaveFields::kPacket + 1) * WaveFields::kPacket;
    for (int i = 0; i < padded; ++i) {
      const bool inside = i <= num_cells_;
      const double hardened = 1.0 + (inside ? soft.hardening_coefficient * fields.strain[i] : 0.0);
      rows_.strength[i] = soft.yield_strength * power(hardened, soft.hardening_exponent) / kSqrt3;
      rows_.compliance[i] = soft.hardening_coefficient / (kappa_ * hardened) * give(i);
      rows_.t[i] = 0.0;
      rows_.x[i] = kUnknown;
      rows_.T[i] = SteinbergCochranGuinan::kReference;
      stress_old_[i] = inside ? fields.stress[i] : 0.0;
      velocity_old_[i] = i < num_cells_ ? fields.velocity[i] : 0.0;
    }
    if (fields.has_guess) std::copy_n(fields.guess, num_cells_, fields.velocity);
  }

  WaveAnswer advance(int newton_steps) {
    if (!descend({}, newton_steps, false)) {
      search(kGuardedSteps);
      if (!balanced()) {
        evaluations_left_ = evaluations_;
        search(kMostGuardedSteps);
      }
      answer_.found = (evaluations_left_ > 0 || step_.forced) && balanced();
    }
    finish();
    return answer_;
  }

 private:
  double give(int i) const { return i == 0 ? step_.give_near : i == num_cells_ ? step_.give_far : 1.0; }
  double gain(int i) const {  // trial stress per velocity difference  [Pa s/m]
    return step_.soft->shear_modulus * step_.dt / step_.grid->weight[static_cast<std::size_t>(i)] / give(i);
  }
  double kappa(int i) const { return kappa_ / give(i); }  // trial stress per plastic strain  [Pa]
  double inertia(int c) const {                           // stress difference per change of velocity  [Pa s/m]
    return step_.soft->density * step_.grid->width[static_cast<std::size_t>(c)] / step_.dt;
  }
  double velocity_behind(int c) const { return c < num_cells_ ? fields_.velocity[c] : step_.jump; }

  double residual(int c) const {  // residual of the balance of momentum  [Pa]
    return fields_.stress[c + 1] - fields_.stress[c] - inertia(c) * (fields_.velocity[c] - velocity_old_[c]);
  }

  // Sign of the trial stress at z = 0, or of the jump while that stress is 0.
  double direction_at_interface() const { return std::copysign(1.0, rows_.t[0] != 0.0 ? rows_.t[0] : step_.jump); }

  void set_trial_stress() {
    double before = 0.0;
    for (int i = 0; i <= num_cells_; ++i) {
      const double v = velocity_behind(i);
      // NOLINTNEXTLINE(clang-analyzer-core.UndefinedBinaryOperatorResult): the constructor sets all rows, to `padded`
      rows_.t[i] = stress_old_[i] + gain(i) * (v - before);
      before = v;
    }
  }

  // Evaluates stresses and slopes at the iterate, with the temperatures T = T_ad + q B of a given heat flux q.
  void evaluate_at(double flux) {
    --evaluations_left_;
    answer_.flux = flux;
    for (int i = 0; i <= num_cells_; ++i) rows_.T[i] = fields_.T_ad[i] + flux * step_.response[i];
    has_form_ ? return_to_yield(law_, T_melt_, bracket_, num_cells_ + 1, rows_, fields_.stress) : return_by_law();
    flux_slope_ = 0.0;
    held_ = std::abs(fields_.stress[0]) > step_.coulomb;
    if (!held_) return;
    fields_.stress[0] = std::copysign(step_.coulomb, rows_.t[0]);
    rows_.slope[0] = rows_.softening[0] = 0.0;
  }

  void return_by_law() {
    for (int i = 0; i <= num_cells_; ++i) {
      const LawReturn& by_law = i == 0 ? by_law_near_ : i == num_cells_ ? by_law_far_ : by_law_;
      const ReturnedStress found = by_law.at(fields_.strain[i], std::abs(rows_.t[i]), rows_.T[i], 0.0);
      fields_.stress[i] = std::copysign(found.stress, rows_.t[i]);
      rows_.slope[i] = found.slope;
      rows_.softening[i] = std::copysign(1.0, rows_.t[i]) * found.softening;
    }
  }

  // Evaluates stresses and slopes at the iterate, for the given heat flux q or else for the heat flux of the stress at
  // z = 0.
  void evaluate(std::optional<double> given) {
    set_trial_stress();
    if (given) return evaluate_at(*given);
    const double direction = direction_at_interface();
    const double per_stress = step_.heat_share * std::max(0.0, direction * step_.jump);  // heat flux per stress [m/s]
    // The return at z = 0 with the heat of the stress itself, q = per_stress |s|: the strength falls with that heat, so
    // there is one root, below melting if T_ad is.
    const ReturnedStress found =
        by_law_near_.at(fields_.strain[0], std::abs(rows_.t[0]), fields_.T_ad[0], per_stress * step_.response[0]);
    const bool held = found.stress > step_.coulomb;
    const double size = held ? step_.coulomb : found.stress, slope = held ? 0.0 : found.slope;
    evaluate_at(per_stress * size);
    held_ = held;
    fields_.stress[0] = std::copysign(size, rows_.t[0]);
    rows_.slope[0] = slope;
    flux_slope_ = direction * (per_stress * slope);
  }

  // Newton's step dv of the cell velocities: solves the linearised balance of momentum, one equation (row) per cell.
  // The elimination goes from the far end of the layer to z = 0. It adds the terms of stiffness and inertia without a
  // difference, so these terms do not cancel. "Behind" is farther from z = 0, "before" nearer. Row c becomes
  //   dv[c] = constant[c] + carry[c] dv[c-1] + coupling[c] dv[0],
  // where the last term is the softening by the heat that the stress at z = 0 causes.
  void newton_direction() {
    ++answer_.iterations;
    double stiffness = 0.0;  // fall of the stress behind a cell per velocity of the cell  [Pa s/m]
    double excess = 0.0;     // diagonal of a cell's equation without the vertex before the cell  [Pa s/m]
    double heat = 0.0;       // what the eliminated rows behind add to a row's coefficient of dv[0]  [Pa s/m]
    double pushed = 0.0;     // what the eliminated rows behind add to a row's residual  [Pa]
    const double heat_gain = flux_slope_ * gain(0);
    for (int i = num_cells_; i >= 0; --i) {
      const double k = rows_.slope[i] * gain(i);
      const double softens = i > 0 ? rows_.softening[i] * step_.response[i] * heat_gain : 0.0;
      if (i < num_cells_) {
        residual_[i] = residual(i);
        const double pivot = excess + k;
        const double own = i > 0 ? pivot : std::max(pivot - heat, 0.5 * pivot);
        constant_[i] = (residual_[i] + pushed) / own;
        carry_[i] = k / pivot;
        coupling_[i] = i > 0 ? (heat - softens) / pivot : 0.0;
        pushed = k * constant_[i];
        heat = softens * (excess / pivot) + carry_[i] * heat;
        stiffness = k * (excess / pivot);
      } else {
        pushed = 0.0;
        heat = softens;
        stiffness = k;
      }
      if (i > 0) excess = inertia(i - 1) + stiffness;
    }
    direction_[0] = constant_[0];
    for (int c = 1; c < num_cells_; ++c) {
      direction_[c] = constant_[c] + carry_[c] * direction_[c - 1] + coupling_[c] * direction_[0];
    }
  }

  struct Largest {
    double velocity;  // largest magnitude of a velocity, the imposed jump included  [m/s]
    double stress;    // largest magnitude of a stress  [Pa]
  };
  Largest largest() const {
    Largest of{std::abs(step_.jump), std::abs(fields_.stress[num_cells_])};
    for (int c = 0; c < num_cells_; ++c) {
      of.velocity = std::max(of.velocity, std::abs(fields_.velocity[c]));
      of.stress = std::max(of.stress, std::abs(fields_.stress[c]));
    }
    return of;
  }

  double largest_step() const {
    double largest = 0.0;
    for (int c = 0; c < num_cells_; ++c) {
      const double size = std::abs(direction_[c]);
      largest = size <= largest ? largest : size;  // a NaN counts as the largest
    }
    return largest;
  }

  // Whether Newton's step is small relative to the sum of the largest velocity of the layer and of what would cause the
  // largest stress.
  bool small_step() const {
    const auto [v, s] = largest();
    const double per_stress = velocity_per_stress(*step_.soft, *step_.grid, step_.dt);
    return largest_step() <= kConverged * (v + s * per_stress) + kNothing;
  }

  // Slope of the energy (see search()) along Newton's direction, after the fraction `part` of the step.
  double slope_after(double part, std::optional<double> flux) {
    for (int c = 0; c < num_cells_; ++c) fields_.velocity[c] = start_[c] + part * direction_[c];
    evaluate(flux);
    double slope = 0.0;
    for (int c = 0; c < num_cells_; ++c) slope -= direction_[c] * residual(c);
    return slope;
  }

  // Moves the slopes towards those of lines through 0. With the latter a step is the minimum of an energy that is nowhere
  // below that of the layer, so that it descends in full. Newton's own steps hardly move layers that flow under one stress
  // and weigh little, since whole parts of them are free to move.
  void mix_secants(double share) {
    for (int i = 0; i <= num_cells_; ++i) {
      const double line = rows_.t[i] != 0.0 ? std::abs(fields_.stress[i] / rows_.t[i]) : 1.0;
      rows_.slope[i] += share * (line - rows_.slope[i]);
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
      newton_direction();
      if (!std::isfinite(largest_step())) return false;
      const bool last = secant == 0.0 && small_step();
      std::copy_n(fields_.velocity, num_cells_, start_);
      double slope_0 = 0.0;
      for (int c = 0; c < num_cells_; ++c) slope_0 -= direction_[c] * residual_[c];
      double slope = slope_after(1.0, flux);
      if (last) return true;
      // The line search needs a direction along which the energy falls. Where the heating by the stress is solved
      // along with it, the balance is not the gradient of an energy; then the whole Newton step may be taken.
      double lo = 0.0;
      double hi = 1.0;
      double part = 1.0;
      for (int k = 0; k < kBisections && slope_0 < 0.0; ++k) {
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
      if (!surely || !step_.forced) continue;  // between imposed velocities the bits stay as they were
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
    answer_.guarded = true;
    const double share = step_.heat_share * step_.jump;
    double lo = 0.0;
    double hi = std::max(0.0, (T_melt_ - fields_.T_ad[0]) / step_.response[0]);
    std::copy_n(velocity_old_, num_cells_, fields_.velocity);
    descend(0.0, steps, true);
    const auto made = [&] { return share * fields_.stress[0]; };  // heat flux q that the stress at z = 0 causes
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
  bool balanced() const {
    const auto [v, s] = largest();
    const double ulp = std::numeric_limits<double>::epsilon() * v;
    for (int c = 0; c < num_cells_; ++c) {
      const double accepted = kBalanced * (s + kLeastStress + inertia(c) * v) + kUlps * ulp * (gain(c) + gain(c + 1));
      if (!(std::abs(residual(c)) <= accepted)) return false;
    }
    return true;
  }

  // Computes plastic strain and interface slip from the difference between trial stress and stress.
  void finish() {
    for (int i = 0; i <= num_cells_; ++i) {
      fields_.strain_growth[i] = std::max(0.0, std::abs(rows_.t[i]) - std::abs(fields_.stress[i])) / kappa(i);
    }
    if (!held_) return;
    const double left = std::abs(rows_.t[0]) - step_.coulomb;
    const double flow = by_law_.strain_under(step_.coulomb, fields_.strain[0], rows_.T[0], left / kappa(0));
    fields_.strain_growth[0] = flow;
    answer_.interface_slip = std::copysign(std::max(0.0, left - kappa(0) * flow) / gain(0), rows_.t[0]);
  }

  const WaveStep& step_;
  WaveFields& fields_;
  int num_cells_;
  double kappa_;  // sqrt(3) G0: stress per plastic strain  [Pa]
  ReturnLaw law_;
  double T_melt_, bracket_;  // return_to_yield()
  // The return of a law that ReturnLaw does not describe, and that of the vertices at z = 0 and z = h.
  LawReturn by_law_, by_law_near_, by_law_far_;
  bool has_form_;  // the law has the form of ReturnLaw
  WaveAnswer answer_;
  int evaluations_;  // largest number of evaluations of the balance in a search
  int evaluations_left_;
  bool held_ = false;        // the friction limit mu P holds the stress at z = 0
  double flux_slope_ = 0.0;  // derivative of q by the trial stress at z = 0  [W/(m2 Pa)]
  ReturnRows rows_;
  alignas(64) Row stress_old_;
  alignas(64) Row velocity_old_;
  Row residual_, constant_, carry_, coupling_, direction_, start_;
};

}  // namespace

WaveAnswer advance_waves(const WaveStep& step, WaveFields& fields, int newton_steps, int evaluations) {
  return Waves(step, fields, evaluations).advance(newton_steps);
}

}  // namespace shearbus::physics
