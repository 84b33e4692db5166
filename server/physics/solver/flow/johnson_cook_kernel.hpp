// The strain increment of Johnson and Cook's law (material/johnson_cook.hpp) in registers, for searched_flow_kernel.hpp.
// Strengths are in units of the yield strength A, logarithms are natural.

class JohnsonCookSearch {
 public:
  [[gnu::always_inline]] JohnsonCookSearch(const Material& m, double dt, const FlowLoad& at, int lane)
      : load_(load(at.load + lane)),
        stress_(short_exp_of(smaller(load_, all(kMostLoad)))),
        loads_(load_ > kNoLoad),
        T_ref_(m.reference_temperature),
        inverse_range_(1.0 / (load(at.T_melt + lane) - m.reference_temperature)),
        B_(m.hardening_modulus / m.yield_strength),
        inverse_B_(m.yield_strength / m.hardening_modulus),
        n_(m.hardening_exponent),
        inverse_n_(1.0 / m.hardening_exponent),
        m_(m.thermal_exponent),
        C_(m.rate_coefficient),
        inverse_C_(C_ > 0.0 ? 1.0 / C_ : 0.0),
        log_slow_(C_ > 0.0 ? logarithm(m.reference_strain_rate * dt) : kNever) {}

  [[gnu::always_inline]] Register moved_from(Register last_load) const {
    return smaller(larger(load_ - last_load, all(-kFarthest)), all(kFarthest));
  }

  // With u = 1 + B (ep + dep)^n, w = 1 + C (x - ln(r0 dt)) and x = ln(dep), a vertex flows if the strength `target` that
  // carries the stress is above 1 + B ep^n; then u w = target.
  [[gnu::always_inline]] VertexFlow flow(const LoadedVertex& at, bool rest_is_known) const {
    const Register share = (at.T - T_ref_) * inverse_range_;
    const Register within = larger(smaller(share, all(1.0)), all(kLeastShare));
    const Register lost = short_exp_of(m_ * short_log_of(within));
    const Mask softens = share > kLeastShare;
    const Register left = where(softens, 1.0 - lost, all(1.0));
    const Mask solid = (share < 1.0) & (left > 0.0);
    const Register inverse_left = 1.0 / where(solid, left, all(1.0));
    const Register carried = smaller(stress_ * inverse_left, all(kMostTarget));
    const Register target = where(solid, carried, where(loads_, all(kMostTarget), all(0.0)));
    const Register rest = rest_is_known ? at.rest : 1.0 + B_ * power_of_strain(at.ep);
    const Mask yields = at.wanted & (target > rest);
    Root root{at.guess, all(0.0), all(1.0)};
    if (lanes_where(yields) == 0) return {all(0.0), all(0.0), root.x, rest};
    Mask creeps = yields;
    if (C_ > 0.0) {
      root.x = larger(smaller(at.guess, all(kMostLogStrain)), all(log_slow_));
      if (lanes_where(yields & without(at.has_guess)) != 0) root.x = where(at.has_guess, root.x, above(target, rest));
      search(at.ep, target, rest, yields, at.has_guess, root);
      creeps = yields & (root.x <= log_slow_);
    }
    if (lanes_where(creeps) != 0) creep(at.ep, target, rest, creeps, root);
    const Register lost_rate = where(solid & softens, (m_ * inverse_range_) * lost * inverse_left / within, all(0.0));
    const Register growth = at.rise * lost_rate;
    return {where(yields, root.dep, all(0.0)), where(yields, (1.0 + growth) / root.log_slope, all(0.0)), root.x, rest};
  }

 private:
  static constexpr double kLeastShare = 1e-300, kLeastStrain = 1e-300, kMostStrain = 1e100;
  static constexpr double kMostLogStrain = 230.0, kMostLoad = 690.0, kMostTarget = 1e130;
  static constexpr double kNever = 1e3;       // replaces ln(r0 dt) if C = 0
  static constexpr double kFarthest = 1.0;    // largest change of ln(a) along which a root is moved
  static constexpr double kConverged = 1e-5;  // a step of ln(dep) shorter than this ends the search
  static constexpr double kMostBend = 0.5;    // limit of Halley's correction of Newton's step
  static constexpr double kFar = 0.5;  // a first step longer than this starts the search anew, from above the root
  static constexpr int kMostIterations = 60;

  struct Root {
    Register x, dep, log_slope;  // ln(dep), dep, derivative of ln(u w) by dep
  };

  [[gnu::always_inline]] Register power_of_strain(Register ep) const {
    const Mask strained = ep > kLeastStrain;
    return where(strained, short_exp_of(n_ * short_log_of(where(strained, ep, all(1.0)))), all(0.0));
  }

  // A start above the root: the smaller of the ln(dep) without rate hardening and that without strain hardening.
  [[gnu::always_inline]] Register above(Register target, Register rest) const {
    const Register unhardened = log_slow_ + (target - rest) / rest * inverse_C_;
    const Register strain = smaller(larger((target - 1.0) * inverse_B_, all(kLeastStrain)), all(kMostStrain));
    const Register unrated = short_log_of(strain) * inverse_n_;
    return larger(smaller(smaller(unhardened, unrated), all(kMostLogStrain)), all(log_slow_));
  }

  // Halley's method. f = u w - target is rising and convex in x, so that the search falls to the root from any start
  // above it; a start below the root overshoots it once. The last step gives dep and the slope by Taylor series.
  [[gnu::always_inline]] void search(Register ep, Register target, Register rest, Mask moves, Mask guessed,
                                     Root& root) const {
    for (int iteration = 0; iteration < kMostIterations; ++iteration) {
      const Register x = root.x, dep = short_exp_of(x), strain = ep + dep;
      const Register share = dep / strain;
      const Register p = B_ * short_exp_of(n_ * short_log_of(strain));
      const Register u = 1.0 + p, w = 1.0 + C_ * (x - log_slow_);
      const Register u_1 = n_ * p * share, u_2 = u_1 * (1.0 + (n_ - 1.0) * share);
      const Register f = u * w - target, f_1 = u_1 * w + C_ * u;
      const Register inverse = 1.0 / f_1, newton = f * inverse;
      const Register bend = 0.5 * newton * (u_2 * w + 2.0 * C_ * u_1) * inverse;
      const Register step = newton / (1.0 - larger(smaller(bend, all(kMostBend)), all(-kMostBend)));
      Register next = smaller(larger(x - step, all(log_slow_)), all(kMostLogStrain));
      if (iteration == 0) {
        const Mask far = moves & guessed & (magnitude(x - next) > kFar);
        if (lanes_where(far) != 0) next = where(far, above(target, rest), next);
      }
      const Register along = x - next;
      const Register dep_new = dep * (1.0 - along * (1.0 - 0.5 * along * (1.0 - (1.0 / 3.0) * along)));
      const Register u_new = u - u_1 * along, w_new = w - C_ * along;
      const Register log_slope = ((u_1 - u_2 * along) * w_new + C_ * u_new) / (u_new * w_new * dep_new);
      root.x = where(moves, next, root.x);
      root.dep = where(moves, dep_new, root.dep);
      root.log_slope = where(moves, log_slope, root.log_slope);
      moves &= magnitude(along) > kConverged;
      if (lanes_where(moves) == 0) break;
    }
  }

  // dep where the rate does not harden: (ep^n + (target - rest) / B)^(1/n) - ep, without a difference if ep > 0.
  [[gnu::always_inline]] void creep(Register ep, Register target, Register rest, Mask creeps, Root& root) const {
    const Register rise = (target - rest) * inverse_B_;
    const Mask strained = ep > kLeastStrain;
    const Register before = where(strained, power_of_strain(ep), all(1.0));
    const Register ratio = larger(rise / before, all(0.0));
    const Register grown = exp_minus_1_of(inverse_n_ * log_of_1_plus(smaller(ratio, all(kMostTarget))));
    const Register fresh =
        short_exp_of(inverse_n_ * short_log_of(smaller(larger(rise, all(kLeastStrain)), all(kMostTarget))));
    const Register flows = smaller(larger(where(strained, ep * grown, fresh), all(kLeastStrain)), all(kMostStrain));
    const Register strain = ep + flows;
    const Register p = B_ * short_exp_of(n_ * short_log_of(strain));
    root.dep = where(creeps, flows, root.dep);
    root.log_slope = where(creeps, n_ * p / (strain * (1.0 + p)), root.log_slope);
  }

  Register load_, stress_;
  Mask loads_;
  double T_ref_;
  Register inverse_range_;
  double B_, inverse_B_, n_, inverse_n_, m_, C_, inverse_C_, log_slow_;
};
