// Newton's method of waves.hpp for the lanes of one register; each_register.hpp includes this file once per register
// width. Each lane follows its own iteration: its answer is written when it has converged, and what it computes while
// other lanes go on is not used.

[[gnu::always_inline]] inline Register with_sign_of(Register size, Register sign) {
  constexpr std::uint64_t kSign = 0x8000000000000000u;
  return double_of(bits_of(size) | (bits_of(sign) & kSign));
}

// Softening g by DLP (15) at a temperature, and its logarithmic derivative; g = 0 where nothing is solid.
struct Softened {
  Register g, log_slope;
};
[[gnu::always_inline]] inline Softened softened(const WaveTile& tile, Register T_melt, Register bracket, Register T) {
  const Register x = larger(T_melt - T, all(kLeastToMelting)), b = larger(bracket - tile.hT * T, all(kLeastBracket));
  const Register inverse = 1.0 / (x * b);
  const Register inverse_x = b * inverse;
  const Register exponent = larger(-kMelting * T * inverse_x, all(-kExponentialRange));
  return {where(exponent > -kExponentialRange, b * Exponential(exponent).value(), all(0.0)),
          -(tile.hT * (x * inverse) + (kMelting * T_melt) * (inverse_x * inverse_x))};
}

// The return of trial stresses to the yield stress (waves_return.hpp): first whether they exceed it.
[[gnu::always_inline]] inline Mask yielding(const WaveTile& tile, Register trial, Softened soft, Register strength) {
  return magnitude(trial) > smaller(strength * soft.g, tile.ceiling * soft.g);
}

// `known`: the x of the iterate before, or kUnknown.
struct Returned {
  Register stress, slope, softening, x;
};
[[gnu::always_inline]] inline Returned returned(const WaveTile& tile, Mask yields, Register trial, Softened soft,
                                                Register strength, Register compliance, Register known) {
  const Register t = magnitude(trial), yield = strength * soft.g, limit = tile.ceiling * soft.g;
  // The hardened yield stress: x + stiffness ((1 + x)^n - 1) = excess, by steps r (1 + x) of Newton's method, and close to
  // the root of Chebyshev's, which is of third order. From below the root steps stay below it.
  const double n = tile.exponent, half_bend = 0.5 * (n - 1.0);
  const Register excess = compliance * larger(t - yield, all(0.0)), stiffness = compliance * yield;
  Register x = where(known >= 0.0, known, excess / (1.0 + n * stiffness)), hardened = yield;
  Mask still = yields;
  for (int iteration = 0; iteration < kReturnSteps && lanes_where(still) != 0; ++iteration) {
    const Register q = 1.0 + x;
    const Register gained = Exponential(n * log_of(q)).minus_1();
    const Register slope = n * (1.0 + gained);
    const Register inverse = 1.0 / (q + stiffness * slope);
    const Register newton = (excess - x - stiffness * gained) * inverse;
    const Register curved = newton - half_bend * (stiffness * slope * inverse) * (newton * newton);
    const Register r = where(magnitude(newton) < kNear, curved, newton);
    hardened = where(still, yield * ((1.0 + gained) + slope * (r + half_bend * (r * r))), hardened);
    x = where(still, larger(x + q * r, all(0.0)), x);
    still &= magnitude(r * r * r) * (1.0 + stiffness) > kLocallyConverged;
  }
  const Mask capped = hardened >= limit;
  const Register s = where(capped, limit, hardened);
  const Register hardening = where(capped, all(0.0), n * s * compliance), q = 1.0 + x;
  const Register inverse = 1.0 / (q + hardening);
  const Register softening = where(yields, s * soft.log_slope * (q * inverse), all(0.0));
  return {where(yields, with_sign_of(s, trial), trial), where(yields, hardening * inverse, all(1.0)),
          with_sign_of(magnitude(softening), -trial), where(yields, x, known)};
}

class WaveLanes {
 public:
  [[gnu::always_inline]] WaveLanes(const WaveTile& tile, WaveRows& rows, int lane)
      : tile_(tile),
        step_(tile.step),
        rows_(rows),
        lane_(lane),
        T_melt_(load(tile.T_melt + lane)),
        bracket_(load(tile.bracket + lane)),
        jump_(load(step_.jump + lane)),
        give_near_(load(step_.give_near + lane)),
        give_far_(load(step_.give_far + lane)),
        gain_near_(tile.gain[0] / give_near_),
        gain_far_(tile.gain[tile.num_cells] / give_far_) {}

#if SHEARBUS_WIDTH > 1
  std::uint32_t solve(std::uint32_t wanted) {
    start();
    std::uint32_t solved = 0;
    Mask live = mask_of(wanted);
    Register iterations{};
    for (int iteration = 0; iteration < step_.most_steps && lanes_where(live) != 0; ++iteration) {
      live &= evaluate_interface(live);
      return_vertices(
          1, [&](std::ptrdiff_t i, Register trial, Register T)
                 __attribute__((always_inline)) { return return_by_form(i, trial, T); });
      const Size size = newton_direction();
      iterations += 1.0;
      live &= size.step <= kFarthestStep;  // not so if it is no number
      const Register scale = size.velocity + size.stress * tile_.velocity_per_stress;
      const Mask last = live & (size.step <= kConverged * scale + kNothing) &
                        (size.residual <= kBalanced * (size.stress + kLeastStress));
      if (const std::uint32_t found = lanes_where(last); found != 0) {
        write(last, iterations);
        solved |= found;
        live &= without(last);
      }
      for (std::ptrdiff_t c = 0; c < tile_.num_cells; ++c)
        put(at(rows_.velocity, c) + at(rows_.direction, c), rows_.velocity, c);
    }
    return solved;
  }
#endif

 protected:
  [[gnu::always_inline]] Register at(const double* rows, std::ptrdiff_t i) const {
    return load(rows + i * kLanes + lane_);
  }
  [[gnu::always_inline]] void put(Mask mask, Register value, double* rows, std::ptrdiff_t i) const {
    double* place = rows + i * kLanes + lane_;
    store(where(mask, value, load(place)), place);
  }
  [[gnu::always_inline]] void put(Register value, double* rows, std::ptrdiff_t i) const {
    store(value, rows + i * kLanes + lane_);
  }

  [[gnu::always_inline]] Register give(std::ptrdiff_t i) const {
    return i == 0 ? give_near_ : i == tile_.num_cells ? give_far_ : all(1.0);
  }
  [[gnu::always_inline]] Register gain(std::ptrdiff_t i) const {  // trial stress per velocity difference  [Pa s/m]
    return i == 0 ? gain_near_ : i == tile_.num_cells ? gain_far_ : all(tile_.gain[i]);
  }
  [[gnu::always_inline]] Register velocity_behind(std::ptrdiff_t i) const {
    return i < tile_.num_cells ? at(rows_.velocity, i) : jump_;
  }
  [[gnu::always_inline]] Register trial_at_interface() const {
    return at(step_.stress, 0) + gain_near_ * at(rows_.velocity, 0);
  }

  void start() {
    const double n = tile_.exponent;
    const double* guess = step_.guess != nullptr ? step_.guess : step_.velocity;
    for (std::ptrdiff_t i = 0; i <= tile_.num_cells; ++i) {
      const Register hardened = 1.0 + tile_.beta * at(step_.strain, i);
      put(tile_.yield * Exponential(n * log_of(hardened)).value(), rows_.strength, i);
      put((tile_.beta * tile_.per_kappa) / hardened * give(i), rows_.compliance, i);
      put(all(kUnknown), rows_.x, i);
      if (i < tile_.num_cells) put(at(guess, i), rows_.velocity, i);
    }
    interface_ = flux_ = flux_slope_ = Register{};
    held_ = Mask{};
  }

  [[gnu::always_inline]] Softened softened_at(Register T) const {
    return softened(tile_, T_melt_, bracket_, T);
  }

  // The stress that the vertex at z = 0 carries at the temperature that the stress a itself causes, where t is its
  // trial stress, with its derivatives d log(stress)/da and d stress/dt.
  struct Carried {
    Register stress, log_slope, flow_slope;
  };
  [[gnu::always_inline]] Carried carried(Register a, Register t, Register rise) const {
    const Softened soft = softened_at(at(step_.T_ad, 0) + rise * a);
    const Register compliance = at(rows_.compliance, 0);
    const Register flow = 1.0 + compliance * (t - a);
    const Register hardened = at(rows_.strength, 0) * Exponential(tile_.exponent * log_of(flow)).value();
    const Mask capped = hardened >= tile_.ceiling;
    const Register stress = where(capped, all(tile_.ceiling), hardened) * soft.g;
    const Register hardening = where(capped, all(0.0), tile_.exponent * compliance / flow);
    return {stress, rise * soft.log_slope - hardening, stress * hardening};
  }

  // How the stress at z = 0 heats: its direction, that of the trial stress or of the jump while that stress is 0, and the
  // heat flux per stress  [m/s].
  struct Heating {
    Register direction, per_stress;
  };
  [[gnu::always_inline]] Heating heating_under(Register trial) const {
    const Register direction = with_sign_of(all(1.0), where(trial == 0.0, jump_, trial));
    return {direction, step_.heat_share * larger(direction * jump_, all(0.0))};
  }
  // The vertex at z = 0 carries a stress, or the friction limit holds it. `slope`: derivative of `stress` by `trial`.
  [[gnu::always_inline]] void carry(Register trial, const Heating& heating, Register stress, Register slope) {
    const Register limit = load(step_.coulomb + lane_);
    held_ = stress > limit;
    const Register size = where(held_, limit, stress), size_slope = where(held_, all(0.0), slope);
    flux_ = heating.per_stress * size;
    flux_slope_ = heating.direction * heating.per_stress * size_slope;
    put(with_sign_of(size, trial), rows_.stress, 0);
    put(size_slope * gain_near_, rows_.stiffness, 0);
    put(Register{}, rows_.softening, 0);
  }

  // The return to the yield stress at z = 0 with the heat of the stress itself. Returns the lanes that have it; the
  // others are left to WaveSearch.
  Mask evaluate_interface(Mask live) {
    const Register trial = trial_at_interface();
    const Heating heating = heating_under(trial);
    const Register rise = heating.per_stress * step_.response[0];
    const Register t = magnitude(trial);
    const Mask elastic = carried(t, t, rise).stress >= t;
    Register lo{}, hi = smaller(t, carried(all(0.0), t, rise).stress);
    Mask sought = live & without(elastic), capped{};
    if (step_.tries_limit) {
      const Register limit = load(step_.coulomb + lane_);
      capped = sought & (limit < t) & (carried(smaller(limit, t), t, rise).stress > limit);
      sought &= without(capped);
    }
    const Mask molten = sought & (hi == 0.0), lost = sought & without(molten) & without(hi > kLeastReturn);
    sought &= without(molten | lost);
    Register a = where((interface_ > 0.0) & (interface_ < hi), interface_, hi), slope{};
    a = where(sought, a, all(1.0));
    hi = where(sought, hi, all(1.0));
    Register farthest = all(kUnlimited);  // a longer step bisects, once Newton's steps have not been enough
    for (int iteration = 0; iteration < kInterfaceSteps && lanes_where(sought) != 0; ++iteration) {
      const Carried now = carried(a, t, rise);
      const Mask above = now.stress > a;
      lo = where(above, a, lo);
      hi = where(above, hi, a);
      const Mask positive = now.stress > kLeastReturn;
      const Register ratio = where(positive, now.stress / a, all(1.0));
      const Register off = log_of(ratio), step = off * a / (1.0 - a * now.log_slope);
      const Register next = a + step;
      const Mask closed = hi - lo <= kRounding * hi;
      const Mask found =
          sought & (closed | (positive & (magnitude(step) <= kReturned * a) & (magnitude(off) <= kSameStress)));
      const Mask inside = positive & (next > lo) & (next < hi) & (magnitude(step) <= farthest);
      if (iteration >= kInterfaceNewton) farthest = 0.5 * magnitude(step);
      const Register best = where(closed, lo, smaller(larger(next, lo), hi));
      slope = where(sought & positive, now.flow_slope / (1.0 - now.stress * now.log_slope), slope);
      a = where(sought, where(found, best, where(inside, next, 0.5 * (lo + hi))), a);
      sought &= without(found);
    }
    interface_ = where(elastic | molten | capped, interface_, a);
    carry(trial, heating, where(molten, all(0.0), where(elastic | capped, t, a)), where(elastic, all(1.0), slope));
    return without(lost | sought);
  }

  // The returns of the vertices from `first` on to the yield stress by `return_of(vertex, trial stress, temperature)`.
  template <class ReturnOf>
  [[gnu::always_inline]] void return_vertices(std::ptrdiff_t first, const ReturnOf& return_of) {
    Register before = first > 0 ? at(rows_.velocity, first - 1) : Register{};
    for (std::ptrdiff_t i = first; i <= tile_.num_cells; ++i) {
      const Register v = velocity_behind(i), stiffness = gain(i);
      const Register trial = at(step_.stress, i) + stiffness * (v - before);
      before = v;
      const Returned now = return_of(i, trial, at(step_.T_ad, i) + flux_ * step_.response[i]);
      put(now.stress, rows_.stress, i);
      put(now.slope * stiffness, rows_.stiffness, i);
      put(now.softening * step_.response[i], rows_.softening, i);
    }
  }
  [[gnu::always_inline]] Returned return_by_form(std::ptrdiff_t i, Register trial, Register T) {
    const Softened soft = softened_at(T);
    const Register strength = at(rows_.strength, i);
    const Mask yields = yielding(tile_, trial, soft, strength);
    if (lanes_where(yields) == 0) return {trial, all(1.0), Register{}, Register{}};
    const Returned now = returned(tile_, yields, trial, soft, strength, at(rows_.compliance, i), at(rows_.x, i));
    put(now.x, rows_.x, i);
    return now;
  }

  struct Size {
    Register step, velocity, stress, residual;  // largest magnitudes of the layer
  };
  // Newton's step of the cell velocities, in rows_.direction: solves the linearised balance of momentum, one equation
  // (row) per cell. The elimination goes from the far end of the layer to z = 0. It adds the terms of stiffness and
  // inertia without a difference, so these terms do not cancel. "Behind" is farther from z = 0, "before" nearer. Row c
  // becomes
  //   dv[c] = constant[c] + carry[c] dv[c-1] + coupling[c] dv[0],
  // where the last term is the softening by the heat that the stress at z = 0 causes. stiffness: fall of the stress
  // behind a cell per velocity of the cell; excess: diagonal of a cell's equation without the vertex before it; heat and
  // pushed: what the eliminated rows behind add to a row's coefficient of dv[0] and to its residual.
  Size newton_direction() {
    Register stiffness{}, excess{}, heat{}, pushed{};
    const Register heat_gain = flux_slope_ * gain_near_;
    Size size{Register{}, magnitude(jump_), Register{}, Register{}};
    Register stress_behind{};
    for (std::ptrdiff_t i = tile_.num_cells; i >= 0; --i) {
      const Register k = at(rows_.stiffness, i), s = at(rows_.stress, i);
      const Register softens = at(rows_.softening, i) * heat_gain;
      size.stress = larger(size.stress, magnitude(s));
      if (i < tile_.num_cells) {
        const Register v = at(rows_.velocity, i);
        size.velocity = larger(size.velocity, magnitude(v));
        const Register residual = stress_behind - s - tile_.inertia[i] * (v - at(step_.velocity, i));
        size.residual = larger(size.residual, magnitude(residual));
        const Register pivot = excess + k;
        const Register inverse = 1.0 / pivot;
        if (i > 0) {
          const Register constant = (residual + pushed) * inverse, carry = k * inverse;
          put(constant, rows_.direction, i);
          put(carry, rows_.carry, i);
          put((heat - softens) * inverse, rows_.coupling, i);
          pushed = k * constant;
          stiffness = carry * excess;
          heat = softens * (excess * inverse) + carry * heat;
        } else {
          put((residual + pushed) / larger(pivot - heat, 0.5 * pivot), rows_.direction, 0);
        }
      } else {
        heat = softens;
        stiffness = k;
      }
      stress_behind = s;
      if (i > 0) excess = tile_.inertia[i - 1] + stiffness;
    }
    const Register first = at(rows_.direction, 0);
    Register d = first, odd = 0.0 * d;  // odd: no number if a step is none, which the largest does not show
    size.step = magnitude(d);
    for (std::ptrdiff_t c = 1; c < tile_.num_cells; ++c) {
      d = at(rows_.direction, c) + at(rows_.carry, c) * d + at(rows_.coupling, c) * first;
      put(d, rows_.direction, c);
      size.step = larger(size.step, magnitude(d));
      odd += 0.0 * d;
    }
    size.step += odd;
    return size;
  }

  // Writes the answers of the lanes whose next Newton step would change nothing: the iterate itself, whose stresses have
  // been evaluated, and the sums of its slip. The flow of a vertex that friction holds is left to the caller.
  void write(Mask solved, Register evaluations) {
    Register positive{}, negative{}, before{};
    for (std::ptrdiff_t i = 0; i <= tile_.num_cells; ++i) {
      const Register v = velocity_behind(i), s = at(rows_.stress, i);
      const Register trial = at(step_.stress, i) + gain(i) * (v - before);
      before = v;
      if (i == 0) put(solved, trial, rows_.trial_at_interface, 0);
      Register growth = larger(magnitude(trial) - magnitude(s), all(0.0)) * tile_.per_kappa * give(i);
      if (i == 0) growth = where(held_, all(0.0), growth);
      const Register slip = (kSqrt3 * step_.grid->weight[static_cast<std::size_t>(i)]) * growth;
      const Mask below = (bits_of(s) >> 63) != 0;
      positive += where(below, all(0.0), slip);
      negative += where(below, slip, all(0.0));
      put(solved, at(step_.strain, i) + growth, step_.strain, i);
      put(solved, s, step_.stress, i);
      if (i < tile_.num_cells) put(solved, v, step_.velocity, i);
    }
    put(solved, positive, rows_.answer.slip_along[0], 0);
    put(solved, negative, rows_.answer.slip_along[1], 0);
    put(solved, flux_, rows_.answer.flux, 0);
    put(solved, evaluations, rows_.answer.evaluations, 0);
    rows_.held |= lanes_where(held_ & solved) << lane_;
  }

  const WaveTile& tile_;
  const WaveStep& step_;
  WaveRows& rows_;
  int lane_;
  Register T_melt_, bracket_, jump_, give_near_, give_far_;
  Register gain_near_, gain_far_;  // trial stress per velocity at z = 0 and z = h
  Register interface_, flux_,
      flux_slope_;  // stress at z = 0 from which its next return starts; q; dq by the trial stress
  Mask held_;       // the friction limit holds the stress at z = 0
};

#if SHEARBUS_WIDTH > 1
inline std::uint32_t solve_waves(const WaveTile& tile, WaveRows& rows, std::uint32_t lanes) {
  std::uint32_t solved = 0;
  for (int lane = 0; lane < kLanes; lane += kWidth) {
    const std::uint32_t wanted = lanes >> lane & kAllOfRegister;
    if (wanted != 0) solved |= WaveLanes(tile, rows, lane).solve(wanted) << lane;
  }
  return solved;
}
#endif
