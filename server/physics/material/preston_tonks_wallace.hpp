// Preston, Tonks, Wallace, J. Appl. Phys. 93 (2003) 211. In units of the shear modulus G(P, T), with Y = 2 G tau,
// T^ = T/T_melt and r = (dep/dt) / (gamma xi), where xi = 1/2 (4 pi rho / (3 M))^(1/3) (G / rho)^(1/2) is the rate at
// which a shear wave crosses an atom of mass M:
//
//   tau_s = max(s0 - (s0 - s_inf) erf(kappa T^ ln(1/r)), s0 r^beta)                           saturation
//   tau_y = max(y0 - (y0 - y_inf) erf(kappa T^ ln(1/r)), min(y1 r^y2, s0 r^beta))             yield
//   tau   = tau_s + (d/p) ln(1 - (1 - exp(-x)) exp(-p theta ep / (d (exp(x) - 1)))),
//           d = s0 - tau_y, x = p (tau_s - tau_y) / d                                         hardening, after Voce
//
// Departures from the paper:
//   1. Y is 0 at T_melt and above: Y = 2 G tau m(T) with m = exp(-0.001 T/(T_melt - T)) of DLP (15). m multiplies the
//      whole of Y; it enters neither r nor xi.
//   2. G(P, T) = G0 (1 + gP P) (1 - alpha T^). G0, the shear modulus of the body, is that of P = 0 and T = 0. The
//      elasticity of the layer keeps G0. rho in xi is the density at rest. So g(P, T) = (G/G0) m and H = 2 G0 tau.
//   3. Below 1e-3 1/s, where the law was fitted to no data, the rate has no effect, so that a layer has a yield stress.
//   4. For r > 1 the argument of erf stays 0: thermal activation ends where the rate reaches the attempt rate.
//   5. tau is multiplied by 1 + 1e-9 min(ln r, 0). Where erf is 1 to its last digit and hardening has saturated, the
//      printed law has one stress for many rates; the factor keeps rate and strain functions of the stress.
//
// fault_of() accepts only constants with tau_s = tau_y = s0 r^beta for r >= 1: nothing hardens there and the inverse
// has a closed form. For r < 1 the flow solves tau(ep + dep, r) = sqrt(3) a / (2 G0 g) for y = ln r, between the slowest
// rate and 1. tau rises with ln r (tests/unit), so the root is unique. tau is computed from tau_y up, tau = tau_y +
// (d/p) ln(1 + (exp(x) - 1) (1 - exp(-...))), which cancels nothing.

class PrestonTonksWallace {
 public:
  static constexpr std::string_view kName = "preston_tonks_wallace";
  static constexpr std::string_view kEquation = "Preston, Tonks, Wallace 2003";
  static constexpr std::string_view kAdds =
      "a flow stress whose rate and temperature are coupled, up to overdriven shocks";
  static constexpr std::string_view kWhen = "rates from 1e-3 to 1e12 1/s, where the rate matters";
  static constexpr std::array kConstants = {
      &Material::molar_mass,          &Material::work_hardening_rate,  &Material::work_hardening_curvature,
      &Material::saturation_cold,     &Material::saturation_hot,       &Material::yield_cold,
      &Material::yield_hot,           &Material::activation,           &Material::attempt_rate,
      &Material::medium_rate_yield,   &Material::medium_rate_exponent, &Material::overdriven_exponent,
      &Material::modulus_temperature, &Material::pressure_coefficient};

  static constexpr bool kDependsOnRate = true;
  static constexpr bool kSeparable = false;
  static constexpr bool kFirstOrderInTime = true;
  static constexpr bool kVanishesAtMelting = true;
  static constexpr bool kHasPressureTerm = true;
  static constexpr bool kHasCeiling = false;
  static constexpr bool kHasWaveReturn = false;

  // Checks that the flow stress Y rises with strain and rate, falls with temperature, and follows the power law of
  // shocks, tau = s0 r^beta, for r >= 1.
  static LawFault fault_of(const Material& m) {
    if (m.saturation_hot > m.saturation_cold)
      return {"saturation_stress_hot", "expected at most saturation_stress_cold"};
    if (m.yield_hot > m.yield_cold) return {"yield_stress_hot", "expected at most yield_stress_cold"};
    if (m.yield_cold > m.saturation_cold) return {"yield_stress_cold", "expected at most saturation_stress_cold"};
    if (m.yield_hot > m.saturation_hot) return {"yield_stress_hot", "expected at most saturation_stress_hot"};
    if (m.medium_rate_yield < m.saturation_cold)
      return {"medium_rate_yield_coefficient", "expected at least saturation_stress_cold"};
    if (m.medium_rate_exponent < m.overdriven_exponent)
      return {"medium_rate_yield_exponent", "expected at least overdriven_exponent"};
    if (m.medium_rate_exponent > 1.0) return {"medium_rate_yield_exponent", "expected at most 1"};
    if (m.activation > 1.0) return {"activation_coefficient", "expected at most 1"};
    if (m.modulus_temperature > kMostSoftening) return {"modulus_temperature_coefficient", "expected at most 0.6"};
    if (m.work_hardening_curvature > kMostCurvature) return {"work_hardening_curvature", "expected at most 100"};
    if (!(attempts(m) > kLeastAttempts))
      return {"attempt_rate_coefficient", "expected an attempt rate gamma xi above 1 per second"};
    return {};
  }

  static Softening softening(const Material& m, Register pressure, Register T) {
    const Melting melting = melting_of(m.modulus_temperature, load_at(m, pressure), T);
    const Register g = only(melting.solid, melting.g);
    return {g, g * melting.log_slope};
  }

  // The factor exp(-0.001 T/(T_melt - T)) is steepest at T = 0.9995 T_melt or, if the interval lacks this T, at the end
  // of the interval nearest to it.
  static Register steepest_softening(const Material& m, Register pressure, Register coldest, Register hottest) {
    const double c = kMeltingFactor * m.melting_temperature;
    const Register nearest = larger(m.melting_temperature - hottest, all(0.0));
    const Register farthest = m.melting_temperature - coldest;
    const Register stiffening = load_at(m, pressure).pressed;
    const Mask solid = (farthest > 0.0) & (stiffening > 0.0);
    const Register x = where(solid, smaller(larger(nearest, all(0.5 * c)), farthest), all(1.0));
    const Register melting = exp_of(kMeltingFactor - c / x);  // melting factor exp(-0.001 T / x) at T = T_melt - x
    const double per_kelvin = m.modulus_temperature / m.melting_temperature;
    return only(solid, stiffening * (per_kelvin + (1.0 - per_kelvin * coldest) * melting * c / (x * x)));
  }

  static Register hardened(const Material& m, Register ep, Register rate, Register pressure, Register T) {
    return 2.0 * m.shear_modulus * tau_at(m, ep, rate, pressure, T).stress;
  }
  static Register hardening_slope(const Material& m, Register ep, Register dep, double dt, Register pressure,
                                  Register T) {
    const Register rate = dep / dt;
    const Tau tau = tau_at(m, ep + dep, rate, pressure, T);
    return 2.0 * m.shear_modulus * (tau.by_strain + only(rate > kSlowestRate, tau.by_log_rate / dep));
  }
  static double ceiling(const Material&) { return std::numeric_limits<double>::infinity(); }
  static bool hardens(const Material&) { return true; }

  [[gnu::always_inline]] PrestonTonksWallace(const Material& m, double dt, const VertexLoad& load)
      : load_(load),
        theta_(m.work_hardening_rate),
        p_(m.work_hardening_curvature > kLeastCurvature ? m.work_hardening_curvature : kLeastCurvature),
        inverse_p_(1.0 / p_),
        s0_(m.saturation_cold),
        s_range_(m.saturation_cold - m.saturation_hot),
        y0_(m.yield_cold),
        y_range_(m.yield_cold - m.yield_hot),
        kappa_(m.activation),
        y1_(m.medium_rate_yield),
        y2_(m.medium_rate_exponent),
        beta_(m.overdriven_exponent),
        alpha_(m.modulus_temperature),
        log_attempts_in_step_(logarithm(attempts(m) * dt)),
        slowest_strain_(kSlowestRate * dt),
        log_slowest_(logarithm(kSlowestRate / attempts(m))) {
    const Register carried = (kSqrt3 / (2.0 * m.shear_modulus)) * load.stress;
    carried_ = where(carried > kLeastStress, carried, all(kNoStress));
  }

  // A vertex flows if the stress tau that it must carry, `target`, is above its strength at rest: tau at the slowest
  // rate. That is only computed where no guess of the root is at hand, or the search from the guess goes below the
  // slowest rate.
  [[gnu::always_inline]] VertexFlow flow(const LoadedVertex& at) const {
    const Vertex vertex = vertex_at(at.T);
    const Mask overdriven = vertex.target >= s0_;
    Search root;
    root.lo = vertex.log_slowest;
    root.hi = all(0.0);
    root.crept = root.by_log_rate = root.by_strain = root.by_T_hat = all(0.0);
    root.creeps = root.suspect = Mask{};
    root.yields = at.wanted & (overdriven | at.has_guess);
    root.y = where(overdriven, all(0.0), larger(smaller(at.guess, all(-kLeastBelow)), root.lo));
    if (anywhere(overdriven)) {
      const Register fast = log_of(vertex.target / s0_) / beta_;
      root.y = where(overdriven, fast, root.y);
      root.by_log_rate = only(overdriven, beta_ * vertex.target);
    }
    root.guessed = root.moves = at.wanted & at.has_guess & without(overdriven);
    Mask unknown = at.wanted & without(root.yields);
    while (true) {
      if (anywhere(unknown)) start_from_rest(vertex, at.ep, unknown, root);
      search(vertex, at.ep, root);
      if (!anywhere(root.suspect)) break;
      unknown = root.suspect;
      root.guessed &= without(unknown);
      root.suspect = Mask{};
    }
    return answer(vertex, at, root);
  }

 private:
  static constexpr double kPi = 3.141592653589793;
  static constexpr double kAvogadro = 6.02214076e23;  // Avogadro constant  [1/mol]
  static constexpr double kSlowestRate = 1e-3;        // slowest rate  [1/s]; slower flow has the strength of this rate
  static constexpr double kRateSensitivity = 1e-9;    // tau is multiplied by 1 + this * min(ln r, 0)
  static constexpr double kLeastAttempts = 1.0;       // attempt rates gamma xi up to this one are refused  [1/s]
  // Largest alpha accepted. In hotter metal xi is smaller, so r is larger, which alone would raise the flow stress Y.
  // Up to this alpha Y falls with T nevertheless.
  static constexpr double kMostSoftening = 0.6;
  static constexpr double kMostCurvature = 100.0;    // largest p accepted, so that exp(p) is a moderate number
  static constexpr double kLeastCurvature = 1e-12;   // used for p = 0 (Voce's law): avoids 0/0, same tau
  static constexpr double kLeastStress = 0x1p-1022;  // smallest stress that is a load, over 2 G0
  static constexpr double kNoStress = -1e305;        // replaces smaller stresses: not even a molten vertex flows
  static constexpr double kLeastTarget = 1e-300, kMostTarget = 1e100;  // range of the tau that a vertex must carry
  static constexpr double kMostLogStrain = 230.0;  // largest ln(dep), far above the strains of any host
  static constexpr double kLeastBelow = 1e-12;     // a guess is at least this far below ln r = 0
  static constexpr double kLeastSlope = 1e-30;     // least d tau / d ln(dep), relative to tau
  static constexpr double kNearRest = 1e-12;       // rounding of tau, relative to the target, in the test for creep()
  static constexpr double kMostGone = 1.0 - 0x1p-53;
  static constexpr double kArrived = 1e-8;  // a Newton step of ln r shorter than this ends the search
  // A step of ln r by interpolation through two points has an error of about the square of (length of the step) *
  // (distance of the two points). The search ends if this product is at most kArrivedByTwo: the error is then below
  // rounding.
  static constexpr double kArrivedByTwo = 3e-8;
  // Longest step of ln r by interpolation that may end the search. Interpolation is used only where a change of ln r by
  // 3 kSmooth leaves every max() and min() in tau at the same argument.
  static constexpr double kSmooth = 3e-4;
  // Interpolation corrects Newton's step only if the correction is at most this multiple of the square of the step.
  static constexpr double kMostBend = 4.0;
  static constexpr double kRounding = 3e-15;  // rounding error of tau, relative to the target
  // After kNewtonIterations every second iteration bisects the bracket; usually 2 to 5 iterations are enough.
  static constexpr int kNewtonIterations = 12, kMostIterations = 150;
  static constexpr double kNoBranch = -100.0;  // near a switch of a max() or min(); no code of branches

  // tau = Y / (2 G), with the flow stress Y before the melting factor, and its derivatives by ln r, ep and T^.
  struct Tau {
    Register stress, by_log_rate, by_strain, by_T_hat;
    Register branch;  // code for the arguments that max() and min() select in tau_s and tau_y; kNoBranch near a switch
  };
  // The saturation stress tau_s and the yield stress tau_y, their derivatives by ln r and T^, and the hardening between.
  struct Branches {
    Register tau_s, tau_y, s_rate, y_rate, s_T, y_T, branch;
    Register hardens;  // largest possible hardening: the smaller of tau_s - tau_y and d
    Register d;        // scale of the hardening in Voce's law, s0 - tau_y
    Register share;    // hardens / d; 1 if nothing hardens
    Mask do_harden;
  };
  struct Melting {
    Register modulus, T_hat;  // G / G0, T / T_melt
    Register g, log_slope;    // softening g and dln(g)/dT, where `solid`; else some number and 0
    Register log_modulus_slope;
    Mask solid;
  };
  // A vertex at its temperature.
  struct Vertex {
    Melting melting;
    Register target;                  // stress tau to carry: sqrt(3) a / (2 G0 g)
    Register log_scale, log_slowest;  // ln(dep) at r = 1, ln r at the slowest rate
  };
  struct Search {
    Register y, lo, hi, crept;                  // ln r and its bracket; dep where the rate has no effect
    Register by_log_rate, by_strain, by_T_hat;  // derivatives of tau at the root
    Mask moves, yields, creeps;
    Mask guessed, suspect;  // started from a guess; the search from it went below the slowest rate
  };

  // The attempt rate gamma xi at the modulus G0   [1/s]
  static double attempts(const Material& m) {
    const double per_length = 4.0 * kPi * m.density * kAvogadro / (3.0 * m.molar_mass);
    return m.attempt_rate * 0.5 * power(per_length, 1.0 / 3.0) * std::sqrt(m.shear_modulus / m.density);
  }
  static VertexLoad load_at(const Material& m, Register pressure) {
    return {all(0.0), 1.0 + m.pressure_coefficient * pressure, all(m.melting_temperature)};
  }
  static Tau tau_at(const Material& m, Register ep, Register rate, Register pressure, Register T) {
    const PrestonTonksWallace law(m, 1.0, load_at(m, pressure));
    const Vertex vertex = law.vertex_at(T);
    return law.tau(log_of(larger(rate, all(kSlowestRate))) - vertex.log_scale, ep, vertex.melting.T_hat);
  }

  [[gnu::always_inline]] static Melting melting_of(double alpha, const VertexLoad& load, Register T) {
    const Mask pressed = load.pressed > 0.0;
    const Register to_melting = load.T_melt - T;
    Melting at;
    at.T_hat = smaller(T / load.T_melt, all(1.0));
    at.modulus = where(pressed, load.pressed, all(1.0)) * (1.0 - alpha * at.T_hat);
    at.solid = pressed & (to_melting > (kMeltingFactor / kExponentialRange) * T);
    const Register inverse_x = 1.0 / where(at.solid, to_melting, load.T_melt);
    at.g = at.modulus * exp_of(-(kMeltingFactor * T * inverse_x));
    at.log_modulus_slope = only(at.solid, -alpha / (load.T_melt - alpha * T));
    at.log_slope = only(at.solid, at.log_modulus_slope - kMeltingFactor * load.T_melt * inverse_x * inverse_x);
    return at;
  }
  [[gnu::always_inline]] Vertex vertex_at(Register T) const {
    Vertex v;
    v.melting = melting_of(alpha_, load_, T);
    const Mask solid = v.melting.solid;
    const Register carried = carried_ / where(solid, v.melting.g, all(1.0)) + where(solid, all(0.0), all(kMostTarget));
    v.target = smaller(larger(carried, all(kLeastTarget)), all(kMostTarget));
    const Register half_log = 0.5 * log_of(v.melting.modulus);
    v.log_scale = log_attempts_in_step_ + half_log;
    v.log_slowest = log_slowest_ - half_log;
    return v;
  }

  // The sign of the difference of two arguments of a max() or min(), or kNoBranch where a change of ln r by 3 kSmooth
  // may change it. `rates`: sum of the derivatives of both arguments by ln r.
  [[gnu::always_inline]] static Register branch_of(Register difference, Register rates) {
    const Register reach = 3.0 * kSmooth * rates;
    return where(difference < -reach, all(-1.0), where(difference > reach, all(1.0), all(kNoBranch)));
  }
  [[gnu::always_inline]] Branches branches(Register y, Register T_hat) const {
    const Register slower = larger(-y, all(0.0));  // logarithm of 1/r; 0 if r > 1
    const Register activated = kappa_ * T_hat;
    const ErrorFunction erf = error_function(activated * slower);
    const Register over = s0_ * exp_of(beta_ * y), medium = y1_ * exp_of(y2_ * y);
    const Register glide_s = s0_ - s_range_ * erf.value, glide_y = y0_ - y_range_ * erf.value;
    const Register over_rate = beta_ * over, medium_rate = y2_ * medium;
    const Mask is_over = over < medium;
    const Register fast_y = where(is_over, over, medium), fast_rate = where(is_over, over_rate, medium_rate);
    const Mask s_is_over = over > glide_s, y_is_fast = fast_y > glide_y;
    const Register erf_rate = only(y < 0.0, activated * erf.slope);
    const Register erf_T = -kappa_ * slower * erf.slope;
    const Register s_glides = s_range_ * erf_rate, y_glides = y_range_ * erf_rate;
    Branches b;
    b.tau_s = where(s_is_over, over, glide_s);
    b.tau_y = smaller(where(y_is_fast, fast_y, glide_y), b.tau_s);
    b.s_rate = where(s_is_over, over_rate, s_glides);
    b.y_rate = where(y_is_fast, fast_rate, y_glides);
    b.s_T = where(s_is_over, all(0.0), s_range_ * erf_T);
    b.y_T = where(y_is_fast, all(0.0), y_range_ * erf_T);
    b.branch = branch_of(over - glide_s, over_rate + s_glides) +
               3.0 * branch_of(fast_y - glide_y, fast_rate + y_glides) +
               9.0 * branch_of(over - medium, over_rate + medium_rate);
    const Register room = s0_ - b.tau_y;
    b.hardens = smaller(b.tau_s - b.tau_y, room);
    b.do_harden = b.hardens > 0.0;
    b.d = where(b.do_harden, room, all(1.0));
    b.share = where(b.do_harden, b.hardens / b.d, all(1.0));
    return b;
  }

  // The flow stress tau at y = ln r, and its derivatives.
  [[gnu::always_inline]] Tau tau(Register y, Register ep, Register T_hat) const {
    const Branches b = branches(y, T_hat);
    const Register slower = larger(-y, all(0.0));
    const Register grown = exp_minus_1_of(p_ * b.share);
    const Register strained = p_ * theta_ / (b.d * grown) * ep;
    const Register gone = -exp_minus_1_of(-strained);
    const Register left = 1.0 - gone;
    const Register sum = grown * gone;
    const Register hardened = log_of_1_plus(sum) * inverse_p_;
    const Register inverse_sum = 1.0 / (1.0 + sum);
    const Register bend = (1.0 + grown) * larger(gone - strained * left, all(0.0));
    const Register by_s = where(b.do_harden, bend * inverse_sum, all(1.0));
    const Register less = grown * strained * left * inverse_p_ - (1.0 - b.share) * bend;
    const Register by_y = only(b.do_harden, 1.0 - hardened + less * inverse_sum);
    const Register stress = where(b.do_harden, b.tau_y + b.d * hardened, b.tau_s);
    const Register by_rate = larger(by_s * b.s_rate + by_y * b.y_rate, all(0.0));
    const Register sensitive = 1.0 - kRateSensitivity * slower;
    return {stress * sensitive, by_rate * sensitive + only(y < 0.0, kRateSensitivity * stress),
            only(b.do_harden, theta_ * left * inverse_sum * sensitive), (by_s * b.s_T + by_y * b.y_T) * sensitive,
            b.branch};
  }

  // Which of the lanes `unknown` flow, and the starts of their searches.
  [[gnu::always_inline]] void start_from_rest(const Vertex& v, Register ep, Mask unknown, Search& root) const {
    const Register rest = tau(v.log_slowest, ep, v.melting.T_hat).stress;
    const Register above_rest = v.target - rest;
    const Mask yields = unknown & (above_rest > 0.0);
    const Mask room = rest < s0_;
    const Register share = above_rest / where(room, s0_ - rest, all(1.0));
    root.yields = (root.yields & without(unknown)) | yields;
    root.lo = where(unknown, v.log_slowest, root.lo);
    root.hi = where(unknown, all(0.0), root.hi);
    root.y = where(yields, v.log_slowest * (1.0 - share), root.y);
    root.moves |= yields;
    const Mask near_rest = yields & (above_rest <= theta_ * slowest_strain_ + kNearRest * v.target);
    if (anywhere(near_rest)) creep(v, ep, near_rest, root);
  }

  // dep of the vertices that flow more slowly than the slowest rate, that is, whose tau reaches the target within one
  // step at this rate. Their tau does not depend on the rate, so dep follows from the inverse of Voce's hardening.
  [[gnu::always_inline]] void creep(const Vertex& v, Register ep, Mask near_rest, Search& root) const {
    const Register y = v.log_slowest, T_hat = v.melting.T_hat;
    const Tau slow = tau(y, ep + slowest_strain_, T_hat);
    const Branches b = branches(y, T_hat);
    const Register grown = exp_minus_1_of(p_ * b.share);
    const Register wanted = v.target / (1.0 + kRateSensitivity * y) - b.tau_y;
    const Register some_gone = exp_minus_1_of(p_ * (wanted / b.d)) / grown;
    const Register gone = larger(smaller(some_gone, all(kMostGone)), all(0.0));
    const Register strain = log_of_1_plus(gone / (1.0 - gone)) * (b.d * grown / (p_ * theta_));
    const Register flows = only(b.do_harden, larger(strain - ep, all(0.0)));
    const Mask creeps = near_rest & (slow.stress >= v.target);
    root.crept = smaller(flows, all(slowest_strain_));
    root.y = where(creeps, y, root.y);
    root.by_log_rate = where(creeps, all(0.0), root.by_log_rate);
    root.by_strain = where(creeps, slow.by_strain, root.by_strain);
    root.by_T_hat = where(creeps, slow.by_T_hat, root.by_T_hat);
    root.moves &= without(creeps);
    root.creeps |= creeps;
  }

  // Solves tau = target for y inside the bracket, lane by lane: a lane that has arrived keeps its root while others go
  // on. The first step is Newton's. A later step adds the correction of inverse Hermite interpolation: the cubic of y
  // over tau through the last two points and slopes, which is of order 2.7 if both points are on the same branches of
  // tau. A step that leaves the bracket is replaced by bisection. A lane that started from a guess and goes below its
  // bracket becomes a suspect.
  [[gnu::always_inline]] void search(const Vertex& v, Register ep, Search& root) const {
    Register last_y{}, last_missing{}, last_inverse{}, last_branch = all(2.0 * kNoBranch);
    for (int iteration = 0; iteration < kMostIterations; ++iteration) {
      if (!anywhere(root.moves)) break;
      const bool bisects = iteration >= kNewtonIterations && iteration % 2 == 0;
      const Mask moves = root.moves;
      const Register y = root.y, dep = exp_of(y + v.log_scale);
      const Tau now = tau(y, ep + dep, v.melting.T_hat);
      const Register missing = now.stress - v.target;
      const Mask below = missing < 0.0;
      const Register lo = where(below, y, root.lo), hi = where(below, root.hi, y);
      const Register inverse = 1.0 / (now.by_log_rate + now.by_strain * dep);
      const Register newton = -missing * inverse;
      const Register apart = last_y - y, span = last_missing - missing;
      const Register u = missing / where(span == 0.0, all(1.0), -span);
      const Register a = span * inverse, b = span * last_inverse;
      const Register bend = u * u * ((3.0 * apart - 2.0 * a - b) + u * ((a + b) - 2.0 * apart));
      const Mask smooth = (now.branch == last_branch) & (now.branch > kNoBranch / 2.0);
      const Mask mild = smooth & (magnitude(bend) <= kMostBend * (newton * newton));
      const Register step = where(mild, newton + bend, newton);
      const Register tried = y + step;
      Mask inside = (tried < hi) & (tried > lo);
      if (bisects) inside = Mask{};
      const Mask met = magnitude(missing) <= kRounding * v.target;
      const Register longest = where(mild, kArrivedByTwo / (magnitude(apart) + kArrivedByTwo / kSmooth), all(kArrived));
      const Mask arrived = (inside & (magnitude(step) <= longest)) | met | (hi - lo <= -2.0 * kRounding * lo);
      const Register next = where(met, y, where(inside, tried, 0.5 * (lo + hi)));
      const Mask left = moves & root.guessed & (tried <= v.log_slowest) & without(met);
      last_y = y;
      last_missing = missing;
      last_inverse = inverse;
      last_branch = now.branch;
      root.lo = where(moves, lo, root.lo);
      root.hi = where(moves, hi, root.hi);
      root.y = where(moves, next, y);
      root.by_log_rate = where(moves, now.by_log_rate, root.by_log_rate);
      root.by_strain = where(moves, now.by_strain, root.by_strain);
      root.by_T_hat = where(moves, now.by_T_hat, root.by_T_hat);
      root.suspect |= left;
      root.moves = moves & without(arrived) & without(left);
    }
  }

  // The differential of tau = sqrt(3) a / (2 G0 g) is tau (dlna - dlng) = by_log_rate (dln(dep) - dln(scale)) +
  // by_strain ddep + by_T_hat dT^, with dT = rise dlna and `scale` the dep at r = 1.
  [[gnu::always_inline]] VertexFlow answer(const Vertex& v, const LoadedVertex& at, const Search& root) const {
    const Register searched = exp_of(root.y + v.log_scale, kMostLogStrain);
    const Register dep = where(root.creeps, root.crept, searched);
    const Register by_dep = root.by_log_rate + root.by_strain * dep;
    const Register pull = v.target * (1.0 - v.melting.log_slope * at.rise) +
                          root.by_log_rate * (0.5 * v.melting.log_modulus_slope * at.rise) -
                          root.by_T_hat * (at.rise / load_.T_melt);
    const Register by_load = dep * (pull / larger(by_dep, kLeastSlope * v.target));
    return {only(root.yields, dep), only(root.yields, by_load), root.y, all(0.0)};
  }

  VertexLoad load_;
  Register carried_;  // sqrt(3) a / (2 G0), or kNoStress
  double theta_, p_, inverse_p_, s0_, s_range_, y0_, y_range_, kappa_, y1_, y2_, beta_, alpha_;
  double log_attempts_in_step_, slowest_strain_, log_slowest_;
};
