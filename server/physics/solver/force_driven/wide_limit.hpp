// The limit of the interface in registers, for the kernels of wide_slip_kernel.hpp, which includes this file once per
// register width.

// The limit and the heating of the lanes of one register, with the names of StressLimit and FrictionHeating.
struct Lanes {
  Register T_ad, rise, c, b;
  // Friction stress; infinity: none below the other limits. If friction falls with temperature: its value at T_ad.
  Register coulomb;
  Register offset, T_melt;
  Register bracket_at_0;  // 1 + gP P
  double tresca, hT;
  const Junctions* junctions = nullptr;           // null: no junctions
  const FallsWithTemperature* softens = nullptr;  // null: friction does not depend on temperature
  Register strain_old{};                          // plastic strain of the junctions before the step
  Register load{};                                // stress per friction coefficient, where `softens` is set  [Pa]

  // The strength without the softening g at a slip velocity, and its derivative by the slip over the strength.
  struct Strength {
    Register value, growth;
  };
  [[gnu::always_inline]] bool has_junctions() const { return junctions != nullptr; }
  [[gnu::always_inline]] bool is_softened() const { return softens != nullptr; }
  [[gnu::always_inline]] Strength strength(Register slip) const {
    if (!has_junctions()) return {all(tresca), all(0.0)};
    const Material& metal = junctions->options->metal;
    const Register drawn = 1.0 + metal.hardening_coefficient * (strain_old + junctions->strain_per_slip * slip);
    const Register hardened = metal.yield_strength * power_of(drawn, all(metal.hardening_exponent));
    const double growth = metal.hardening_exponent * metal.hardening_coefficient * junctions->strain_per_slip;
    return {junctions->options->contact_fraction * smaller(hardened, all(metal.yield_strength_max)) / kSqrt3,
            where(hardened < metal.yield_strength_max, growth / drawn, all(0.0))};
  }
  [[gnu::always_inline]] Register slip(Register a) const {
    const Register v = c - b * a;
    return where(v > 0.0, v, all(0.0));
  }
  [[gnu::always_inline]] Register temperature(Register a) const { return T_ad + rise * (a * slip(a)); }
  [[gnu::always_inline]] Register bracket(Register T) const {
    return bracket_at_0 - hT * (T - SteinbergCochranGuinan::kReference);
  }

  // The friction coefficient over its value in the cold, 1 - T*^m, and its derivative by T.
  struct Softened {
    Register kept, fall;
  };
  [[gnu::always_inline]] Softened softened(Register T) const {
    const Register range = T_melt - softens->reference;
    const Register share = (T - softens->reference) / range;
    const Mask warm = share > FallsWithTemperature::kLeastShare;
    const Register known = where(warm, smaller(share, all(1.0)), all(1.0));
    const Register lost = where(warm, power_of(known, all(softens->exponent)), all(0.0));
    return {1.0 - lost, softens->exponent * lost / (known * range)};
  }

  // Friction and yield at a temperature, without `offset` and junctions.
  struct Branches {
    Register friction, yield;
  };
  [[gnu::always_inline]] Branches at(Register T) const {
    const Register to_melting = T_melt - T, open = bracket(T);
    const Mask solid = (to_melting > 0.0) & (open > 0.0);
    const Register exponent = SteinbergCochranGuinan::kMeltingFactor * T / where(solid, to_melting, all(1.0));
    const Register g = open * exp_of(-exponent);
    return {is_softened() ? load * softened(T).kept : coulomb,
            where(solid & (exponent < kExponentialRange), tresca * g, all(0.0))};
  }
};

// Where slip_is_unique() holds, decided by bounds that need no exponential of the melting factor. `end`: an upper bound
// of the stress up to which the answer must be unique.
[[gnu::always_inline]] inline Mask heats_more_up_to(const Lanes& s, Register end) {
  return (2.0 * s.b * end <= s.c) | (s.c <= 0.0);
}
[[gnu::always_inline]] inline Mask falls_steadily(const Lanes& s, Register end) {
  constexpr double kAlmost = 0.999999;  // covers the rounding of these bounds
  const Register melting_scale = SteinbergCochranGuinan::kMeltingFactor * s.T_melt;
  const Register hottest = s.T_ad + s.rise * (0.25 * s.c * s.c / s.b);
  const Register nearest = s.T_melt - hottest;
  const Mask solid = nearest > 0.0;
  const Register x = where(solid, nearest, melting_scale);
  // 1. Friction is the limit at the hottest temperature, where exp(-y) >= 1 - y.
  const Register hot_yield =
      s.strength(all(0.0)).value * (s.bracket(hottest) * (1.0 - SteinbergCochranGuinan::kMeltingFactor * hottest / x));
  const Mask rubs = solid & (s.coulomb <= kAlmost * hot_yield);
  // 2. The slope of the limit is too small: an upper bound of exp(-c/x) c/x^2 is c/x^2, and 0.5414/c at any x.
  const Register scaled = melting_scale / x;
  const Register steepest = where(solid & (scaled < 0.73), 1.0011 * scaled * scaled, all(0.543)) / melting_scale;
  Register slope = s.strength(s.slip(all(0.0))).value * (s.hT + s.bracket(s.T_ad) * steepest);
  if (!s.is_softened()) return rubs | (s.rise * slope * (2.0 * s.b * end - s.c) < kAlmost);
  // 3. Friction, whose slope rises with temperature, is the limit, or it may be.
  const Register friction_slope = s.load * s.softened(where(solid, hottest, s.T_melt)).fall;
  slope = where(rubs, friction_slope, larger(slope, friction_slope));
  return s.rise * slope * (2.0 * s.b * end - s.c) < kAlmost;
}

// Friction that falls with slip is solved before the temperature is known (SlidingFriction). The balance
// h(a) = mu(c - b a) P - a is convex where friction falls with slip, so Newton's method from any stress where h falls
// comes to the left of the smallest zero and stays there. Returns the lanes whose friction was found and is a constant
// in the rest of the step, also for a node that sticks: those in which friction cannot return to above the stress.
[[gnu::always_inline]] inline Mask find_sliding(const FallsWithSlip& law, Register pressure, Register a_stick,
                                                Register guess, Mask wanted, Lanes& s, SearchEffort* effort) {
  constexpr int kSlidingRounds = 20;
  constexpr double kFound = 1e-10;     // largest last step, relative to the stress: the error is about its square
  constexpr double kLeastFall = 1e-3;  // least -dh/da: closer to a double zero rounding decides
  constexpr double kDecided = 1e-9;    // least |h| / (mu P) where its sign decides
  const Register at_rest = law.at_rest * pressure;
  const Register drop = (law.at_rest - law.fast) * pressure;
  const Register end = s.c / s.b;
  const Register steepness = drop * law.decay * s.b;
  const Mask slips = s.c > 0.0, turns = steepness > 1.0;
  // The stress from which on h rises, or where slip ends.
  const Register turn =
      where(turns, larger((s.c - log_of(where(turns, steepness, all(1.0))) / law.decay) / s.b, all(0.0)), end);
  const Register below = smaller(a_stick, s.strength(s.slip(all(0.0))).value * s.bracket(s.T_ad));
  const Register bound = smaller(below, turn);

  struct Balance {
    Register value, slope;
  };
  const auto balance = [&](Register a) __attribute__((always_inline)) {
    const Register varying = drop * exp_of(-law.decay * s.slip(a));
    return Balance{(law.fast * pressure + varying) - a, varying * (law.decay * s.b) - 1.0};
  };
  const Register spare = balance(bound).value;
  const Mask carries = (spare >= 0.0) | without(slips);
  const Mask at_turn = turn < below;
  // Whether the sign of h at the turn decides, and whether friction may return behind the turn.
  const Mask close = at_turn & turns & (magnitude(spare) <= kDecided * larger(at_rest, turn));
  const Mask returns = at_turn & turns & without(carries) & (at_rest > end);

  Mask active = wanted & without(carries) & without(close) & without(returns);
  Mask sure = wanted & without(close) & without(returns) & carries;
  Register a = where((guess > 0.0) & (guess < bound), guess, all(0.0));
  Register root = all(0.0);
  for (int round = 0; lanes_where(active) != 0 && round < kSlidingRounds; ++round) {
    if (effort != nullptr) effort->limit_values += std::popcount(lanes_where(active));
    const Balance h = balance(a);
    const Register next = smaller(larger(a - h.value / h.slope, all(0.0)), bound);
    const Mask done = active & (magnitude(next - a) <= kFound * next);
    sure |= done & (h.slope < -kLeastFall);
    root = where(done, next, root);
    active &= without(done);
    a = next;
  }
  const Register unlimited = all(std::numeric_limits<double>::infinity());
  s.coulomb = where(carries, where(slips & without(at_turn), unlimited, at_rest), root);
  return sure;
}
