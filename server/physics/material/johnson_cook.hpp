// Johnson, Cook, 7th Int. Symp. Ballistics, The Hague (1983) 541:
//
//   H(ep, r) = (A + B ep^n) (1 + C ln(max(r / r0, 1))),   r = dep/dt
//   g(T)     = 1 - T*^m,   T* = (T - T_ref) / (T_melt - T_ref), cut at 0 and 1
//
// A is the material's yield strength, n its hardening exponent. Pressure enters only through T_melt(P), if a scene asks
// for that. The rate is that of the step, dep/dt, and is solved for with the strain. With strengths in units of A, u = 1
// + B (ep + dep)^n, x = ln(dep) and w = 1 + C (x - ln(r0 dt)), the strength that carries the stress is u w: a rising
// convex function of x times a rising affine one, so it is convex and its root is unique. The search starts from a dep
// above the root, the smaller of two: the dep that would carry the stress without rate hardening, and the dep whose rate
// would carry the stress without strain hardening. Where the rate is below r0 the root has a closed form.

class JohnsonCook {
 public:
  static constexpr std::string_view kName = "johnson_cook";
  static constexpr std::string_view kEquation = "Johnson, Cook 1983";
  static constexpr std::string_view kAdds = "a flow stress with its rate, solved with the strain";
  static constexpr std::string_view kWhen = "metals known by that law only";
  static constexpr std::array kConstants = {&Material::yield_strength,        &Material::hardening_modulus,
                                            &Material::hardening_exponent,    &Material::rate_coefficient,
                                            &Material::reference_strain_rate, &Material::thermal_exponent,
                                            &Material::reference_temperature};

  static constexpr bool kDependsOnRate = true;
  static constexpr bool kSeparable = true;
  static constexpr bool kFirstOrderInTime = true;
  static constexpr bool kVanishesAtMelting = true;
  static constexpr bool kHasPressureTerm = false;
  static constexpr bool kHasCeiling = false;
  static constexpr bool kHasWaveReturn = false;

  static LawFault fault_of(const Material& m) {
    if (m.reference_temperature < m.melting_temperature) return {};
    return {"reference_temperature_k", "expected below the melting temperature"};
  }

  static Softening softening(const Material& m, Register /*pressure*/, Register T) {
    return softening_of(m.reference_temperature, m.thermal_exponent,
                        all(1.0 / (m.melting_temperature - m.reference_temperature)), T);
  }

  // The slope |dg/dT| = m T*^(m-1) / (T_melt - T_ref) rises with T where m > 1 and falls where m < 1.
  static Register steepest_softening(const Material& m, Register /*pressure*/, Register coldest, Register hottest) {
    const double range = m.melting_temperature - m.reference_temperature;
    const Register from = m.thermal_exponent < 1.0 ? coldest : hottest;
    const Register share = smaller(larger((from - m.reference_temperature) / range, all(kLeastShare)), all(1.0));
    const Mask softens = (hottest > m.reference_temperature) & (coldest < m.melting_temperature);
    return only(softens, m.thermal_exponent * power_of(share, all(m.thermal_exponent - 1.0)) / range);
  }

  static Register hardened(const Material& m, Register ep, Register rate, Register /*pressure*/, Register /*T*/) {
    return static_strength(m, ep) * rate_factor(m, rate);
  }
  static Register hardening_slope(const Material& m, Register ep, Register dep, double dt, Register /*pressure*/,
                                  Register /*T*/) {
    const Register strain = larger(ep + dep, all(kLeastStrain)), rate = dep / dt;
    const Register hardening =
        m.hardening_exponent * m.hardening_modulus * power_of(strain, all(m.hardening_exponent)) / strain;
    const Register rate_hardening = only(rate > m.reference_strain_rate, m.rate_coefficient / dep);
    return hardening * rate_factor(m, rate) + static_strength(m, strain) * rate_hardening;
  }
  static double ceiling(const Material&) { return std::numeric_limits<double>::infinity(); }
  static bool hardens(const Material&) { return true; }

  [[gnu::always_inline]] JohnsonCook(const Material& m, double dt, const VertexLoad& load)
      : T_ref_(m.reference_temperature),
        thermal_exponent_(m.thermal_exponent),
        stress_((kSqrt3 / m.yield_strength) * load.stress),
        inverse_range_(1.0 / (load.T_melt - m.reference_temperature)),
        B_(m.hardening_modulus / m.yield_strength),
        inverse_B_(m.yield_strength / m.hardening_modulus),
        n_(m.hardening_exponent),
        inverse_n_(1.0 / m.hardening_exponent),
        C_(m.rate_coefficient),
        inverse_C_(C_ > 0.0 ? 1.0 / C_ : 0.0),
        log_slow_(C_ > 0.0 ? logarithm(m.reference_strain_rate * dt) : kNever) {}

  // A vertex flows if the strength `target` that carries its stress is above its strength at rest, 1 + B ep^n.
  [[gnu::always_inline]] VertexFlow flow(const LoadedVertex& at) const {
    const Softening softening = softening_of(T_ref_, thermal_exponent_, inverse_range_, at.T);
    const Mask solid = softening.g > 0.0;
    const Register inverse_g = 1.0 / where(solid, softening.g, all(1.0));
    const Register carried = smaller(stress_ * inverse_g, all(kMostTarget));
    const Register target = where(solid, carried, only(stress_ > kLeastStress, all(kMostTarget)));
    const Register rest = at.rest_is_known ? at.rest : 1.0 + B_ * power_of_strain(n_, at.ep);
    const Mask yields = at.wanted & (target > rest);
    Root root{at.guess, all(0.0), all(1.0)};
    if (!anywhere(yields)) return {all(0.0), all(0.0), root.x, rest};
    Mask creeps = yields;
    if (C_ > 0.0) {
      root.x = larger(smaller(at.guess, all(kMostLogStrain)), all(log_slow_));
      if (anywhere(yields & without(at.has_guess))) root.x = where(at.has_guess, root.x, above(target, rest));
      search(at.ep, target, rest, yields, at.has_guess, root);
      creeps = yields & (root.x <= log_slow_);
    }
    if (anywhere(creeps)) creep(at.ep, target, rest, creeps, root);
    const Register growth = only(solid, -at.rise * softening.slope * inverse_g);
    return {only(yields, root.dep), only(yields, (1.0 + growth) / root.log_slope), root.x, rest};
  }

 private:
  static constexpr double kLeastShare = 1e-300, kLeastStrain = 1e-300, kMostStrain = 1e100;
  static constexpr double kLeastStress = 0x1p-1022;  // smallest stress that is a load, over the yield strength
  static constexpr double kMostLogStrain = 230.0, kMostTarget = 1e130;
  static constexpr double kNever = 1e3;  // replaces ln(r0 dt) if C = 0; above any ln(dep), so the rate has no effect
  static constexpr double kConverged = 1e-5;  // a step of ln(dep) shorter than this ends the search
  static constexpr double kMostBend = 0.5;    // limit of Halley's correction of Newton's step
  static constexpr double kFar = 0.5;  // a first step longer than this starts the search anew, from above the root
  static constexpr int kMostIterations = 60;  // 2 to 5 are usual

  struct Root {
    Register x, dep, log_slope;  // ln(dep), dep, derivative of ln(u w) by dep
  };

  [[gnu::always_inline]] static Softening softening_of(double T_ref, double m, Register inverse_range, Register T) {
    const Register share = (T - T_ref) * inverse_range;
    const Mask softens = share > kLeastShare, solid = share < 1.0;
    if (!anywhere(softens)) return {all(1.0), all(0.0)};
    const Register within = larger(smaller(share, all(1.0)), all(kLeastShare));
    const Register lost = only(softens, power_of(within, all(m)));
    return {only(solid, 1.0 - lost), only(solid, -(m * inverse_range) * lost / within)};
  }
  [[gnu::always_inline]] static Register power_of_strain(double n, Register ep) {
    const Mask strained = without(ep < kLeastStrain);
    return only(strained, power_of(where(strained, ep, all(1.0)), all(n)));
  }
  static Register static_strength(const Material& m, Register ep) {
    return m.yield_strength + m.hardening_modulus * power_of_strain(m.hardening_exponent, ep);
  }
  static Register rate_factor(const Material& m, Register rate) {
    return 1.0 + m.rate_coefficient * log_of(larger(rate / m.reference_strain_rate, all(1.0)));
  }

  // A start above the root: the smaller of the ln(dep) without rate hardening and that without strain hardening.
  [[gnu::always_inline]] Register above(Register target, Register rest) const {
    const Register unhardened = log_slow_ + (target - rest) / rest * inverse_C_;
    const Register strain = smaller(larger((target - 1.0) * inverse_B_, all(kLeastStrain)), all(kMostStrain));
    const Register unrated = log_of(strain) * inverse_n_;
    return larger(smaller(smaller(unhardened, unrated), all(kMostLogStrain)), all(log_slow_));
  }

  // Halley's method for u w = target, lane by lane: a lane that has converged keeps its root while others go on. From any
  // start above the root the search falls to it; a start below the root overshoots it once. The error of a root is of
  // the order of the cube of the last step. This step gives dep and the slope by Taylor series, which saves another
  // exponential and power.
  [[gnu::always_inline]] void search(Register ep, Register target, Register rest, Mask moves, Mask guessed,
                                     Root& root) const {
    for (int iteration = 0; iteration < kMostIterations; ++iteration) {
      const Register x = root.x, dep = exp_of(x), strain = ep + dep;
      const Register share = dep / strain;  // fraction of the strain that is new in this step
      const Register p = B_ * power_of(strain, all(n_));
      const Register u = 1.0 + p, w = 1.0 + C_ * (x - log_slow_);
      const Register u_1 = n_ * p * share, u_2 = u_1 * (1.0 + (n_ - 1.0) * share);  // derivatives of u by x
      const Register f = u * w - target, f_1 = u_1 * w + C_ * u;
      const Register inverse = 1.0 / f_1, newton = f * inverse;
      const Register bend = 0.5 * newton * (u_2 * w + 2.0 * C_ * u_1) * inverse;
      const Register step = newton / (1.0 - larger(smaller(bend, all(kMostBend)), all(-kMostBend)));
      Register next = smaller(larger(x - step, all(log_slow_)), all(kMostLogStrain));
      if (iteration == 0) {
        const Mask far = moves & guessed & (magnitude(x - next) > kFar);
        if (anywhere(far)) next = where(far, above(target, rest), next);
      }
      const Register along = x - next;
      const Register dep_new = dep * (1.0 - along * (1.0 - 0.5 * along * (1.0 - (1.0 / 3.0) * along)));
      const Register u_new = u - u_1 * along, w_new = w - C_ * along;
      const Register log_slope = ((u_1 - u_2 * along) * w_new + C_ * u_new) / (u_new * w_new * dep_new);
      root.x = where(moves, next, root.x);
      root.dep = where(moves, dep_new, root.dep);
      root.log_slope = where(moves, log_slope, root.log_slope);
      moves &= magnitude(along) > kConverged;
      if (!anywhere(moves)) break;
    }
  }

  // dep where the rate does not harden: (ep^n + (target - rest) / B)^(1/n) - ep, without a difference if ep > 0.
  [[gnu::always_inline]] void creep(Register ep, Register target, Register rest, Mask creeps, Root& root) const {
    const Register rise = (target - rest) * inverse_B_;
    const Mask strained = without(ep < kLeastStrain);
    const Register before = where(strained, power_of_strain(n_, ep), all(1.0));
    const Register ratio = larger(rise / before, all(0.0));
    const Register grown = exp_minus_1_of(inverse_n_ * log_of_1_plus(smaller(ratio, all(kMostTarget))));
    const Register fresh = exp_of(inverse_n_ * log_of(smaller(larger(rise, all(kLeastStrain)), all(kMostTarget))));
    const Register flows = smaller(larger(where(strained, ep * grown, fresh), all(kLeastStrain)), all(kMostStrain));
    const Register strain = ep + flows;
    const Register p = B_ * power_of(strain, all(n_));
    root.dep = where(creeps, flows, root.dep);
    root.log_slope = where(creeps, n_ * p / (strain * (1.0 + p)), root.log_slope);
  }

  double T_ref_, thermal_exponent_;
  Register stress_, inverse_range_;
  double B_, inverse_B_, n_, inverse_n_, C_, inverse_C_, log_slow_;
};
