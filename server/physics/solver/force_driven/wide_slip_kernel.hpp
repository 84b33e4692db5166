// The kernels of wide_slip() and of the stages of second order; each_register.hpp includes this file once per register
// width.
#if SHEARBUS_WIDTH > 1

// A lane that needs more rounds of Newton's method is left to slip_stress().
inline constexpr int kRounds = 12;
// Newton's method ends after a step below this fraction of the stress, of the slip and of the distance from melting:
// the error after the step is about the square of that fraction.
inline constexpr double kConverged = 1e-7;
// A root is rounded down by a few ulp, so that a layer as strong as the interface does not flow by rounding.
inline constexpr double kRoundedDown = 1.0 - 0x1p-50;
inline constexpr double kLeastGuess = 1e-12;  // smallest starting stress used, relative to the end of the bracket
// A root is left to slip_stress() if the distance [K] of T0 from the temperature where the bracket of g vanishes is below
// this fraction of the distance from melting: a last step that is short relative to the latter may then be too long.
inline constexpr double kNearWeakest = 0.1;
// Stress below which the logarithm of the limit over the stress is cut  [Pa].
inline constexpr double kLeastStress = 1e-200;
// A root closer to the sticking stress than this fraction is left to rigid_slip(), which decides whether the node
// sticks.
inline constexpr double kClear = 1e-6;
// Where friction and yield differ by less than this fraction, rigid_slip() decides which is the limit.
inline constexpr double kApart = 1e-6;

#include "server/physics/solver/force_driven/wide_limit.hpp"

// A register of the search for the root of log(s_lim / a): the limit less its offset over the stress less the offset.
// Where melting makes the limit fall like exp(-1/x) this function is concave, so that steps from the hot side never
// overshoot; and it needs no exponential.
struct Search {
  Mask active, ended;  // lanes still searched; lanes whose limit exceeds the stress even at `end`
  // Where friction falls with temperature: lanes whose limit is friction, and lanes where the lower of friction and
  // yield is lower by more than the search decides.
  Mask rubs, apart;
  Register a, low, high, end, answer;
  Register bound;  // the smaller of the stress that sticks and the limit without heat
};

[[gnu::always_inline]] inline void improve(const Lanes& s, Search& search) {
  const Register a = search.a;
  const Register v = s.c - s.b * a;
  const Mask slips = v > 0.0;
  const Register slip = where(slips, v, all(0.0));
  const Register T = s.T_ad + s.rise * (a * slip);
  const Lanes::Strength strength = s.strength(slip);
  const Register to_melting = s.T_melt - T, bracket = s.bracket(T);
  Mask solid = (to_melting > 0.0) & (bracket > 0.0);
  const Register x = where(solid, to_melting, all(1.0)), g = where(solid, bracket, all(1.0));
  const Register above = a - s.offset;
  const Register u = where(above > kLeastStress, above, all(kLeastStress));
  const Register xg = x * g;
  const Register inverse = 1.0 / (xg * u);  // one division for 1/x, 1/g and 1/u
  const Register inverse_xg = inverse * u;
  const Register inverse_x = g * inverse_xg;
  Register excess =
      log_of(strength.value * (g * (inverse * xg))) - SteinbergCochranGuinan::kMeltingFactor * T * inverse_x;
  Register fall = s.hT * (x * inverse_xg) +
                  SteinbergCochranGuinan::kMeltingFactor * s.T_melt * (inverse_x * inverse_x);  // -d(log g)/dT
  const Register heating = where(slips, s.rise * (s.c - 2.0 * (s.b * a)), all(0.0));            // dT/da
  Register hardening = where(slips, s.b * strength.growth, all(0.0));                           // -d(log strength)/da
  Mask rubs{};                                                                                  // friction is the limit
  Register gap{}, change{};  // of the logarithms of yield and friction: their difference; bound of its derivative by T
  if (s.is_softened()) {
    const Lanes::Softened friction = s.softened(T);
    const Register share = s.load * friction.kept * (inverse * xg);
    solid &= share > kLeastStress;
    // Below the reference temperature friction is `coulomb`, which the end of the bracket does not exceed.
    const Register rubbing = where(T > s.softens->reference, log_of(where(share > kLeastStress, share, all(1.0))),
                                   all(std::numeric_limits<double>::infinity()));
    const Register friction_fall = friction.fall / friction.kept;
    gap = magnitude(rubbing - excess);
    change = fall + friction_fall;
    rubs = rubbing < excess;
    excess = where(rubs, rubbing, excess);
    fall = where(rubs, friction_fall, fall);
    hardening = where(rubs, all(0.0), hardening);
  }
  Register slope = 1.0 + u * (heating * fall);
  if (s.has_junctions()) slope += u * hardening;
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
  if (s.is_softened()) {
    search.rubs |= done & rubs;
    search.apart |= done & (gap > kApart + 2.0 * magnitude(step * heating) * change);
  }
  search.active &= without(done);
  const Mask inside = solid & (next > search.low) & (next < search.high);
  search.a = where(inside, smaller(next, search.end), 0.5 * (search.low + smaller(search.high, search.end)));
}

// Begins the search for the smallest of `a_stick` and the root of the spare strength. `wanted`: lanes to search.
[[gnu::always_inline]] inline Search begin(const Lanes& s, Register a_stick, Register guess, Mask wanted) {
  Search search{};
  const Register unheated = s.offset + smaller(s.coulomb, s.strength(s.slip(all(0.0))).value * s.bracket(s.T_ad));
  const Register bound = search.bound = smaller(a_stick, unheated);
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

// Whether the search is accurate for an interface whose temperature after the step is T.
[[gnu::always_inline]] inline Mask is_accurate(const Lanes& s, Register T) {
  return s.bracket(T) > (kNearWeakest * s.hT) * (s.T_melt - T);
}

// Whether the search has found the answer: the root, or the end of the bracket if the node sticks or rubs there. A root
// inside the bracket rules out that the node sticks. `a_stick`: stress at which it sticks.
[[gnu::always_inline]] inline Mask settled(const Lanes& s, const Search& search, Register a_stick) {
  const Register a = search.answer;
  const Mask at_end = search.ended & ((a == a_stick) | (a == s.offset + s.coulomb));
  Mask root = without(search.ended) & (a < (1.0 - kClear) * a_stick);
  if (s.is_softened()) root &= search.apart;
  return without(search.active) & (at_end | root);
}

// The trial slip of the lanes of one register, with the names of TrialSlip.
struct Trial {
  Register jump_free, per_stress, direction, jump_old, stress_stick;
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
  Mask rubs = search.ended & (a == s.offset + s.coulomb) & without(sticks);
  if (s.is_softened()) rubs |= without(search.ended) & search.rubs;
  const Register resting = 0.5 * trial.jump_old;
  const Register slip = where(sticks, where(resting > 0.0, resting, all(0.0)), s.slip(a));
  const Register flux = heat_partition * (a * slip);
  const Register T0 = s.T_ad + flux * B0;
  const Mask solid = sticks | ((T0 < s.T_melt) & (s.T_ad + s.rise * (a * slip) < s.T_melt) & is_accurate(s, T0));
  const Register yields =
      where(T0 >= kMeltingShare * s.T_melt, all(number(Regime::kMelting)), all(number(Regime::kTresca)));
  return {trial.direction * a,
          trial.direction * slip,
          where(sticks, all(0.0), trial.jump_free - trial.direction * a * trial.per_stress),
          flux,
          where(sticks, all(number(Regime::kStick)), where(rubs, all(number(Regime::kCoulomb)), yields)),
          static_cast<Mask>(settled(s, search, trial.stress_stick) & solid)};
}

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

// The limits of the lanes of a tile.
class Interface {
 public:
  [[gnu::always_inline]] explicit Interface(const WideInterface& in)
      : in_(in),
        constant_(std::get_if<ConstantCoefficient>(&in.friction)),
        softens_(std::get_if<FallsWithTemperature>(&in.friction)),
        uniform_(in.soft_at.uniform()),
        soft_(in.soft_at(0)) {
    for (int l = 0; !uniform_ && l < kLanes; ++l) {
      T_melt_[l] = in.soft_at(l).melting_temperature;
      pressure_coefficient_[l] = in.soft_at(l).pressure_coefficient;
    }
  }

  // The limit of the lanes from l on, times `factor`, plus `offset` (StressLimit::scaled()).
  [[gnu::always_inline]] Lanes lanes(std::ptrdiff_t l, Register T_ad, double rise, Register c, Register b,
                                     double factor, Register offset) const {
    const Register pressure = load(in_.inputs.pressure + l);
    Lanes s{T_ad,
            all(rise),
            c,
            b,
            constant_ != nullptr ? (constant_->coefficient * pressure) * factor
                                 : all(std::numeric_limits<double>::infinity()),
            offset,
            uniform_ ? all(soft_.melting_temperature) : load(T_melt_ + l),
            1.0 + (uniform_ ? all(soft_.pressure_coefficient) : load(pressure_coefficient_ + l)) * pressure,
            in_.tresca * factor,
            soft_.temperature_coefficient,
            in_.junctions.options != nullptr ? &in_.junctions : nullptr,
            softens_};
    if (s.has_junctions()) s.strain_old = load(in_.junction_strain + l);
    if (s.is_softened()) {
      s.load = (softens_->cold * pressure) * factor;
      s.coulomb = s.load * s.softened(T_ad).kept;
    }
    return s;
  }

 private:
  const WideInterface& in_;
  const ConstantCoefficient* constant_;
  const FallsWithTemperature* softens_;
  bool uniform_;
  const Material& soft_;
  alignas(64) double T_melt_[kLanes], pressure_coefficient_[kLanes];
};

// The forces of the host on the lanes from l on, with the names of Forcing.
struct Forces {
  [[gnu::always_inline]] Forces(const TileInputs& host, std::ptrdiff_t l) {
    const Register mass_soft = load(host.mass_soft + l), mass_hard = load(host.mass_hard + l);
    acceleration = load(host.stress_soft + l) / mass_soft + load(host.stress_hard + l) / mass_hard;
    mobility = 1.0 / mass_soft + 1.0 / mass_hard;
  }
  Register acceleration, mobility;
};

// Whether a lane may change suddenly (changes_suddenly()), by a bound without an exponential.
[[gnu::always_inline]] inline Mask seems_sudden(const Trial& trial, const Search& search) {
  const Register fall = search.bound - search.answer;
  return (trial.stress_stick < fall * (1.0 / kMostSudden)) | (trial.jump_old < 0.0);
}

inline std::uint32_t slip_step(const WideStep& in, const WideStage& whole, WideAnswer& answer) {
  const TileInputs& host = in.interface.inputs;
  const Interface interface(in.interface);
  const auto* by_slip = std::get_if<FallsWithSlip>(&in.interface.friction);
  Lanes lanes[kParts];
  Trial trial[kParts];
  Search search[kParts];

  // 1. The trial slip, the heating and the limit of each lane.
  std::uint32_t active = 0;
  SHEARBUS_EACH_PART {
    const std::ptrdiff_t l = p * kWidth;
    const Forces forces(host, l);
    const Register jump = load(host.velocity_jump + l), pressure = load(host.pressure + l);
    const Register before = load(in.interface.stress_before + l);
    const Register per_stress = in.dt * forces.mobility;
    const Register jump_free = jump + in.dt * forces.acceleration;
    const Register leads = where(jump_free != 0.0, jump_free, before);
    const Register direction = where(leads < 0.0, all(-1.0), all(1.0));
    const Register jump_old = direction * jump;
    trial[p] = {jump_free, per_stress, direction, jump_old, magnitude(jump_free) / per_stress};
    lanes[p] = interface.lanes(l, load(whole.T_ad + l), in.heat_partition * whole.B0,
                               0.5 * (jump_old + direction * jump_free), 0.5 * per_stress, 1.0, all(0.0));
    Mask wanted = mask_of(host.active >> l) & (pressure > 0.0);
    if (by_slip != nullptr)
      wanted =
          find_sliding(*by_slip, pressure, trial[p].stress_stick, magnitude(before), wanted, lanes[p], host.effort);
    search[p] = begin(lanes[p], trial[p].stress_stick, magnitude(before), wanted);
    active |= lanes_where(search[p].active) << l;
  }

  // 2. Newton's method for all lanes.
  const std::uint32_t ended = search_all(lanes, search, active, host.effort);

  // 3. The answers.
  std::uint32_t sure = 0, suspects = 0;
  SHEARBUS_EACH_PART {
    const std::ptrdiff_t l = p * kWidth;
    const Found found = conclude(lanes[p], trial[p], search[p], in.heat_partition, whole.B0);
    const Mask known = found.sure & mask_of(ended >> l);
    sure |= lanes_where(known) << l;
    suspects |= lanes_where(seems_sudden(trial[p], search[p]) & known) << l;
    store(found.stress, answer.stress + l);
    store(found.slip, answer.slip + l);
    store(found.jump_new, answer.jump_new + l);
    store(where(known, found.flux, all(0.0)), answer.flux + l);
    store(found.flux * in.dt, answer.heat + l);
    store(found.regime, answer.regime + l);
    if (lanes[p].has_junctions()) {
      store(lanes[p].strain_old + in.interface.junctions.strain_per_slip * magnitude(found.slip),
            answer.junction_strain + l);
    }
  }
  answer.suspects = suspects;
  return sure;
}
#include "server/physics/solver/force_driven/wide_stages_kernel.hpp"

#endif
