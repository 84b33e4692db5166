// The kernel of wide_slip() and, in the namespace `one`, of quick_slip(); each_register.hpp includes this file once per
// register width.

// A lane that needs more rounds of Newton's method is left to slip_stress().
inline constexpr int kRounds = 12;
// Newton's method ends after a step below this fraction of the stress, of the slip and of the distance from melting:
// the error after the step is about the square of that fraction.
inline constexpr double kConverged = 1e-7;
// A root is rounded down by a few ulp, so that a layer as strong as the interface does not flow by rounding.
inline constexpr double kRoundedDown = 1.0 - 0x1p-50;
inline constexpr double kLeastGuess = 1e-12;  // smallest starting stress used, relative to the end of the bracket
// Stress below which the logarithm of the limit over the stress is cut  [Pa].
inline constexpr double kLeastStress = 1e-200;
// A root closer to the sticking stress than this fraction is left to rigid_slip(), which decides whether the node
// sticks.
inline constexpr double kClear = 1e-6;

// The limit and the heating of the lanes of one register, with the names of StressLimit and FrictionHeating.
struct Lanes {
  Register T_ad, rise, c, b;
  Register coulomb, offset, T_melt;
  Register bracket_at_0;  // 1 + gP P
  double tresca, hT;
  const Junctions* junctions = nullptr;  // only in the namespace `one`

  // The strength without the softening g at a slip velocity, and its derivative by the slip over the strength.
  struct Strength {
    Register value, growth;
  };
  [[gnu::always_inline]] Strength strength([[maybe_unused]] Register slip) const {
#if SHEARBUS_WIDTH == 1
    if (junctions != nullptr) {
      const Junctions::Value hardened = junctions->at(slip);
      return {hardened.strength, hardened.slope / hardened.strength};
    }
#endif
    return {all(tresca), all(0.0)};
  }
  [[gnu::always_inline]] Register slip(Register a) const {
    const Register v = c - b * a;
    return where(v > 0.0, v, all(0.0));
  }
  [[gnu::always_inline]] Register bracket(Register T) const {
    return bracket_at_0 - hT * (T - SteinbergCochranGuinan::kReference);
  }
};

// Where slip_is_unique() holds, decided by bounds that need no exponential. `end`: an upper bound of the stress up to
// which the answer must be unique.
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
  // 2. The slope of the limit is too small: an upper bound of exp(-c/x) c/x^2 is c/x^2, and 0.5414/c at any x.
  const Register scaled = melting_scale / x;
  const Register steepest = where(solid & (scaled < 0.73), 1.0011 * scaled * scaled, all(0.543)) / melting_scale;
  const Register slope = s.strength(s.slip(all(0.0))).value * (s.hT + s.bracket(s.T_ad) * steepest);
  return (solid & (s.coulomb <= kAlmost * hot_yield)) | (s.rise * slope * (2.0 * s.b * end - s.c) < kAlmost);
}

// A register of the search for the root of log(s_lim / a): the limit less its offset over the stress less the offset.
// Where melting makes the limit fall like exp(-1/x) this function is concave, so that steps from the hot side never
// overshoot; and it needs no exponential.
struct Search {
  Mask active, ended;  // lanes still searched; lanes whose limit exceeds the stress even at `end`
  Register a, low, high, end, answer;
};

[[gnu::always_inline]] inline void improve(const Lanes& s, Search& search) {
  const Register a = search.a;
  const Register v = s.c - s.b * a;
  const Mask slips = v > 0.0;
  const Register slip = where(slips, v, all(0.0));
  const Register T = s.T_ad + s.rise * (a * slip);
  const Lanes::Strength strength = s.strength(slip);
  const Register to_melting = s.T_melt - T, bracket = s.bracket(T);
  const Mask solid = (to_melting > 0.0) & (bracket > 0.0);
  const Register x = where(solid, to_melting, all(1.0)), g = where(solid, bracket, all(1.0));
  const Register above = a - s.offset;
  const Register u = where(above > kLeastStress, above, all(kLeastStress));
  const Register xg = x * g;
  const Register inverse = 1.0 / (xg * u);  // one division for 1/x, 1/g and 1/u
  const Register inverse_xg = inverse * u;
  const Register inverse_x = g * inverse_xg;
  const Register excess =
      log_of(strength.value * (g * (inverse * xg))) - SteinbergCochranGuinan::kMeltingFactor * T * inverse_x;
  const Register fall = s.hT * (x * inverse_xg) +
                        SteinbergCochranGuinan::kMeltingFactor * s.T_melt * (inverse_x * inverse_x);  // -d(log g)/dT
  const Register heating = where(slips, s.rise * (s.c - 2.0 * (s.b * a)), all(0.0));                  // dT/da
  Register slope = 1.0 + u * (heating * fall);
  if (kWidth == 1) slope += u * where(slips, s.b * strength.growth, all(0.0));
  const Register step = u * excess / slope;
  const Register next = a + step;

  const Mask carries = solid & (excess >= 0.0);
  search.low = where(carries, a, search.low);
  search.high = where(carries, search.high, a);
  const Mask at_end = carries & (a >= search.end);
  const Mask met = solid & (magnitude(step) <= kConverged * u) & (magnitude(step * heating) <= kConverged * x) &
                   ((magnitude(step * s.b) <= kConverged * v) | without(slips));
  const Register within = smaller(where(next < search.low, search.low, next), search.high);
  const Mask done = search.active & (at_end | met);
  search.answer = where(done, where(at_end, a, kRoundedDown * within), search.answer);
  search.ended |= search.active & at_end;
  search.active &= without(done);
  const Mask inside = solid & (next > search.low) & (next < search.high);
  search.a = where(inside, smaller(next, search.end), 0.5 * (search.low + smaller(search.high, search.end)));
}

// Begins the search for the smallest of `a_stick` and the root of the spare strength. `wanted`: lanes to search.
[[gnu::always_inline]] inline Search begin(const Lanes& s, Register a_stick, Register guess, Mask wanted) {
  Search search{};
  const Register unheated = s.offset + smaller(s.coulomb, s.strength(s.slip(all(0.0))).value * s.bracket(s.T_ad));
  const Register bound = smaller(a_stick, unheated);
  const Mask solid = (s.T_ad < s.T_melt) & (s.bracket(s.T_ad) > 0.0) & (s.rise > 0.0) & (s.b > 0.0) & (s.T_ad > 0.0);
  Mask unique = heats_more_up_to(s, bound);
  if (lanes_where(wanted & without(unique)) != 0) unique |= falls_steadily(s, bound);
  search.active = wanted & solid & unique & (bound >= s.offset);
  // The stress `melting` melts the interface where it leaves at least half of the frictionless slip c.
  const Register melting = 2.0 * (s.T_melt - s.T_ad) / (s.rise * s.c);
  const Mask melts = (s.c > 0.0) & (melting < bound) & (2.0 * s.b * melting <= s.c);
  search.end = where(melts, melting, bound);
  search.low = s.offset;
  search.high = all(std::numeric_limits<double>::infinity());
  const Register half = 0.5 * (search.low + search.end);
  search.a = where(guess < search.end, where(guess - search.low > kLeastGuess * search.end, guess, half),
                   where(melts, half, search.end));
  return search;
}

// The trial slip of the lanes of one register, with the names of TrialSlip.
struct Trial {
  Register jump_free, per_stress, direction, jump_old, drive, stress_stick;
};

// The answer of the lanes of one register, with the names of LaneStep.
struct Found {
  Register stress, slip, jump_new, flux, regime;
  Mask sure;  // whether the lane has this answer; a root inside the bracket rules out that the node sticks
};

[[gnu::always_inline]] constexpr double number(Regime regime) {
  return static_cast<double>(regime);
}

[[gnu::always_inline]] inline Found conclude(const Lanes& s, const Trial& trial, const Search& search,
                                             double heat_partition, double B0) {
  const Register a = search.answer;
  const Mask sticks = search.ended & (a == trial.stress_stick);
  const Mask rubs = search.ended & (a == s.offset + s.coulomb) & without(sticks);
  const Register resting = 0.5 * (trial.jump_old + trial.drive);
  const Register slip = where(sticks, where(resting > 0.0, resting, all(0.0)), s.slip(a));
  const Register flux = heat_partition * (a * slip);
  const Register T0 = s.T_ad + flux * B0;
  const Mask clear = sticks | rubs | (without(search.ended) & (a < (1.0 - kClear) * trial.stress_stick));
  const Mask solid = sticks | ((T0 < s.T_melt) & (s.T_ad + s.rise * (a * slip) < s.T_melt));
  const Register yields =
      where(T0 >= kMeltingShare * s.T_melt, all(number(Regime::kMelting)), all(number(Regime::kTresca)));
  return {trial.direction * a,
          trial.direction * slip,
          where(sticks, 0.0 - trial.direction * trial.drive, trial.jump_free - trial.direction * a * trial.per_stress),
          flux,
          where(sticks, all(number(Regime::kStick)), where(rubs, all(number(Regime::kCoulomb)), yields)),
          static_cast<Mask>(without(search.active) & clear & solid)};
}

#if SHEARBUS_WIDTH == 1

inline std::optional<LaneStep> slip_of_lane(const Lanes& s, const Trial& trial, double heat_partition, double B0,
                                            double guess, SearchEffort* effort) {
  Search search = begin(s, trial.stress_stick, guess, true);
  if (!search.active) return {};
  for (int round = 0; search.active && round < kRounds; ++round) {
    if (effort != nullptr) ++effort->limit_values;
    improve(s, search);
  }
  const Found found = conclude(s, trial, search, heat_partition, B0);
  if (!found.sure) return {};
  const Regime regime = static_cast<Regime>(static_cast<int>(found.regime));
  return LaneStep{found.stress, found.slip, found.jump_new, found.flux, regime, regime == Regime::kStick, true, false};
}

#else

// Searches the lanes `active` of all registers together, until none is left. Returns the lanes that have ended.
[[gnu::always_inline]] inline std::uint32_t search_all(const Lanes (&lanes)[kParts], Search (&search)[kParts],
                                                       std::uint32_t active, SearchEffort* effort) {
  const std::uint32_t begun = active;
  int values = 0;
  for (int round = 0; active != 0 && round < kRounds; ++round) {
    values += std::popcount(active);
    active = 0;
    SHEARBUS_EACH_PART {
      improve(lanes[p], search[p]);
      active |= lanes_where(search[p].active) << p * kWidth;
    }
  }
  if (effort != nullptr) effort->limit_values += values;
  return begun & ~active;
}

inline std::uint32_t stress_step(StressTile& tile, std::uint32_t wanted) {
  Lanes lanes[kParts];
  Search search[kParts];
  std::uint32_t active = 0;
  SHEARBUS_EACH_PART {
    const std::ptrdiff_t l = p * kWidth;
    lanes[p] = {load(tile.T_ad + l),
                load(tile.rise + l),
                load(tile.c + l),
                load(tile.b + l),
                load(tile.coulomb + l),
                load(tile.offset + l),
                load(tile.T_melt + l),
                load(tile.bracket_at_0 + l),
                tile.tresca,
                tile.hT};
    search[p] = begin(lanes[p], load(tile.a_stick + l), load(tile.guess + l), mask_of(wanted >> l));
    active |= lanes_where(search[p].active) << l;
  }
  const std::uint32_t ended = search_all(lanes, search, active, tile.effort);
  std::uint32_t sure = 0;
  SHEARBUS_EACH_PART {
    const std::ptrdiff_t l = p * kWidth;
    const Lanes& s = lanes[p];
    const Register a = search[p].answer, a_stick = load(tile.a_stick + l);
    const Mask at_end = search[p].ended & ((a == a_stick) | (a == s.offset + s.coulomb));
    const Mask clear = at_end | (without(search[p].ended) & (a < (1.0 - kClear) * a_stick));
    sure |= lanes_where(clear & (s.T_ad + s.rise * (a * s.slip(a)) < s.T_melt)) << l;
    store(a, tile.stress + l);
  }
  return ended & sure;
}

inline std::uint32_t slip_step(const WideSlip& in, WideAnswer& answer) {
  const TileInputs& host = in.inputs;
  const bool uniform = in.soft_at.uniform();
  const Material& soft = in.soft_at(0);
  alignas(64) double T_melt[kLanes], pressure_coefficient[kLanes];
  for (int l = 0; !uniform && l < kLanes; ++l) {
    T_melt[l] = in.soft_at(l).melting_temperature;
    pressure_coefficient[l] = in.soft_at(l).pressure_coefficient;
  }
  Lanes lanes[kParts];
  Trial trial[kParts];
  Search search[kParts];

  // 1. The trial slip, the heating and the limit of each lane.
  std::uint32_t active = 0;
  SHEARBUS_EACH_PART {
    const std::ptrdiff_t l = p * kWidth;
    const Register mass_soft = load(host.mass_soft + l), mass_hard = load(host.mass_hard + l);
    const Register jump = load(host.velocity_jump + l), pressure = load(host.pressure + l);
    const Register before = load(in.stress_before + l);
    const Register acceleration = load(host.stress_soft + l) / mass_soft + load(host.stress_hard + l) / mass_hard;
    const Register per_stress = in.dt * (1.0 / mass_soft + 1.0 / mass_hard);
    const Register jump_free = jump + in.dt * acceleration;
    const Register leads = where(jump_free != 0.0, jump_free, before);
    const Register direction = where(leads < 0.0, all(-1.0), all(1.0));
    const Register jump_old = direction * jump;
    trial[p] = {jump_free, per_stress, direction, jump_old, all(0.0), magnitude(jump_free) / per_stress};
    lanes[p] = {load(in.T_ad + l),
                all(in.heat_partition * in.B0),
                0.5 * (jump_old + direction * jump_free),
                0.5 * per_stress,
                in.friction_coefficient * pressure,
                all(0.0),
                uniform ? all(soft.melting_temperature) : load(T_melt + l),
                1.0 + (uniform ? all(soft.pressure_coefficient) : load(pressure_coefficient + l)) * pressure,
                in.tresca,
                soft.temperature_coefficient};
    search[p] = begin(lanes[p], trial[p].stress_stick, magnitude(before), mask_of(host.active >> l) & (pressure > 0.0));
    active |= lanes_where(search[p].active) << l;
  }

  // 2. Newton's method for all lanes.
  const std::uint32_t ended = search_all(lanes, search, active, host.effort);

  // 3. The answers.
  std::uint32_t sure = 0;
  SHEARBUS_EACH_PART {
    const std::ptrdiff_t l = p * kWidth;
    const Found found = conclude(lanes[p], trial[p], search[p], in.heat_partition, in.B0);
    const Mask known = found.sure & mask_of(ended >> l);
    sure |= lanes_where(known) << l;
    store(found.stress, answer.stress + l);
    store(found.slip, answer.slip + l);
    store(found.jump_new, answer.jump_new + l);
    store(where(known, found.flux, all(0.0)), answer.flux + l);
    store(found.flux * in.dt, answer.heat + l);
    store(found.regime, answer.regime + l);
  }
  return sure;
}

#endif
