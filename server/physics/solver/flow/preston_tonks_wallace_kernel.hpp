// The strain increment of Preston, Tonks and Wallace's law (material/preston_tonks_wallace.hpp, whose symbols are used
// here) in registers, for searched_flow_kernel.hpp. Stresses are in units of 2 G0, y = ln r is the root.

class PrestonTonksWallaceSearch {
 public:
  [[gnu::always_inline]] PrestonTonksWallaceSearch(const Material& m, double dt, const FlowLoad& at, int lane)
      : c_(PrestonTonksWallace::constants_of(m, dt)),
        load_(load(at.load + lane)),
        T_melt_(load(at.T_melt + lane)),
        inverse_T_melt_(1.0 / T_melt_),
        pressed_(load(at.bracket + lane) > 0.0),
        bracket_(where(pressed_, load(at.bracket + lane), all(1.0))) {}

  [[gnu::always_inline]] Register moved_from(Register last_load) const {
    const Mask loaded = last_load > 0.0;
    const Register change = (load_ - last_load) / where(loaded, last_load, all(1.0));
    return where(loaded, smaller(larger(change, all(-kFarthest)), all(kFarthest)), all(0.0));
  }

  // A vertex flows if the stress tau that it must carry, `target`, is above its strength at rest: tau at the slowest
  // rate. That is only computed where no guess of the root is at hand, or the search from the guess goes below the
  // slowest rate.
  [[gnu::always_inline]] VertexFlow flow(const LoadedVertex& at, bool /*rest_is_known*/) const {
    const Vertex vertex = vertex_at(at);
    const Mask overdriven = vertex.target >= c_.s0;
    Search root;
    root.lo = vertex.log_slowest;
    root.hi = all(0.0);
    root.crept = root.by_log_rate = root.by_strain = root.by_T_hat = all(0.0);
    root.creeps = root.suspect = overdriven & without(overdriven);
    root.yields = at.wanted & (overdriven | at.has_guess);
    root.y = where(overdriven, all(0.0), larger(smaller(at.guess, all(-kLeastBelow)), root.lo));
    if (lanes_where(overdriven) != 0) {
      const Register fast = (short_log_of(vertex.target) - c_.log_s0) * c_.inverse_beta;
      root.y = where(overdriven, fast, root.y);
      root.by_log_rate = where(overdriven, c_.beta * vertex.target, root.by_log_rate);
    }
    root.guessed = root.moves = at.wanted & at.has_guess & without(overdriven);
    Mask unknown = at.wanted & without(root.yields);
    while (true) {
      if (lanes_where(unknown) != 0) start_from_rest(vertex, at.ep, unknown, root);
      search(vertex, at.ep, root);
      if (lanes_where(root.suspect) == 0) break;
      unknown = root.suspect;
      root.guessed &= without(unknown);
      root.suspect &= without(unknown);
    }
    return answer(vertex, at, root);
  }

 private:
  static constexpr double kMostTarget = 1e100, kLeastTarget = 1e-300, kMostLogStrain = 230.0;
  static constexpr double kFarthest = 1.0;      // largest change of ln(a) along which a root is moved
  static constexpr double kLeastBelow = 1e-12;  // a guess is at least this far below ln r = 0
  static constexpr double kLeastSlope = 1e-30;  // least d tau / d ln(dep), relative to tau
  static constexpr double kNearRest = 1e-12;    // rounding of tau, relative to the target, in the test for creep()
  static constexpr double kMostGone = 1.0 - 0x1p-53;
  // Ends of the search, as in material/preston_tonks_wallace.hpp.
  static constexpr double kArrived = 1e-8, kArrivedByTwo = 3e-8, kSmooth = 3e-4, kMostBend = 4.0, kRounding = 3e-15;
  static constexpr int kNewtonIterations = 12, kMostIterations = 150;
  static constexpr double kNoBranch = -100.0;  // near a switch of a max() or min(); no code of branches

  // A vertex at its temperature.
  struct Vertex {
    Register target, T_hat;           // stress tau to carry, T / T_melt
    Register log_scale, log_slowest;  // ln(dep) at r = 1, ln r at the slowest rate
    Register inverse_g, exponent;     // 1 / g, or 1 where molten; 0.001 T / (T_melt - T)
    Mask solid;
  };
  struct Search {
    Register y, lo, hi, crept;
    Register by_log_rate, by_strain, by_T_hat;  // derivatives of tau at the root
    Mask moves, yields, creeps;
    Mask guessed, suspect;  // started from a guess; the search from it went below the slowest rate
  };
  struct Branches {
    Register tau_s, tau_y, s_rate, y_rate, s_T, y_T, branch, hardens, d, share;
    Mask do_harden;
  };
  struct Reduced {
    Register stress, by_log_rate, by_strain, by_T_hat, branch;
  };

  [[gnu::always_inline]] Vertex vertex_at(const LoadedVertex& at) const {
    Vertex v;
    const Register to_melting = T_melt_ - at.T;
    v.T_hat = smaller(at.T * inverse_T_melt_, all(1.0));
    const Register modulus = bracket_ * (1.0 - c_.alpha * v.T_hat);
    v.exponent = kMeltingFactor * at.T / where(to_melting > 0.0, to_melting, T_melt_);
    v.solid = pressed_ & (to_melting > (kMeltingFactor / kExponentialRange) * at.T);
    const Register g = modulus * short_exp_of(-v.exponent);
    v.inverse_g = 1.0 / where(v.solid, g, all(1.0));
    const Register carried = load_ * v.inverse_g + where(v.solid, all(0.0), all(kMostTarget));
    v.target = smaller(larger(carried, all(kLeastTarget)), all(kMostTarget));
    const Register half_log = 0.5 * short_log_of(modulus);
    v.log_scale = c_.log_attempts_in_step + half_log;
    v.log_slowest = c_.log_slowest - half_log;
    return v;
  }

  // erf(x) and its derivative for x >= 0; error_function() of material/elementary.hpp.
  struct ErrorFunctions {
    Register value, slope;
  };
  [[gnu::always_inline]] static ErrorFunctions error_functions(Register x) {
    const double* q = kErrorSeries;
    const Register within = smaller(x, all(kErrorIsOne));
    const Register u = (11.0 / 6.0 * within - 2.5) / (within + 2.5);
    const Register u2 = u * u, u4 = u2 * u2, u8 = u4 * u4;
    const Register four_0 = (q[0] + u * q[1]) + u2 * (q[2] + u * q[3]);
    const Register four_4 = (q[4] + u * q[5]) + u2 * (q[6] + u * q[7]);
    const Register four_8 = (q[8] + u * q[9]) + u2 * (q[10] + u * q[11]);
    const Register four_12 = (q[12] + u * q[13]) + u2 * (q[14] + u * q[15]);
    const Register last = (q[16] + u * q[17]) + u2 * q[18];
    const Register series = (four_0 + u4 * four_4) + u8 * ((four_8 + u4 * four_12) + u8 * last);
    const Register bell = short_exp_of(-within * within);
    return {where(x < kErrorIsOne, 1.0 - bell * series / (1.0 + 2.0 * within), all(1.0)), kTwoOverSqrtPi * bell};
  }

  // The sign of the difference of two arguments of a max() or min(), or kNoBranch where a change of ln r by 3 kSmooth
  // may change it.
  [[gnu::always_inline]] static Register branch_of(Register difference, Register rates) {
    const Register reach = 3.0 * kSmooth * rates;
    return where(difference < -reach, all(-1.0), where(difference > reach, all(1.0), all(kNoBranch)));
  }

  [[gnu::always_inline]] Branches branches(Register y, Register T_hat) const {
    const Register slower = larger(-y, all(0.0));
    const Register activated = c_.kappa * T_hat;
    const ErrorFunctions erf = error_functions(activated * slower);
    const Register over = c_.s0 * short_exp_of(c_.beta * y), medium = c_.y1 * short_exp_of(c_.y2 * y);
    const Register glide_s = c_.s0 - c_.s_range * erf.value, glide_y = c_.y0 - c_.y_range * erf.value;
    const Register over_rate = c_.beta * over, medium_rate = c_.y2 * medium;
    const Mask is_over = over < medium;
    const Register fast_y = where(is_over, over, medium), fast_rate = where(is_over, over_rate, medium_rate);
    const Mask s_is_over = over > glide_s, y_is_fast = fast_y > glide_y;
    const Register erf_rate = where(y < 0.0, activated * erf.slope, all(0.0));
    const Register erf_T = -c_.kappa * slower * erf.slope;
    const Register s_glides = c_.s_range * erf_rate, y_glides = c_.y_range * erf_rate;
    Branches b;
    b.tau_s = where(s_is_over, over, glide_s);
    b.tau_y = smaller(where(y_is_fast, fast_y, glide_y), b.tau_s);
    b.s_rate = where(s_is_over, over_rate, s_glides);
    b.y_rate = where(y_is_fast, fast_rate, y_glides);
    b.s_T = where(s_is_over, all(0.0), c_.s_range * erf_T);
    b.y_T = where(y_is_fast, all(0.0), c_.y_range * erf_T);
    b.branch = branch_of(over - glide_s, over_rate + s_glides) +
               3.0 * branch_of(fast_y - glide_y, fast_rate + y_glides) +
               9.0 * branch_of(over - medium, over_rate + medium_rate);
    const Register room = c_.s0 - b.tau_y;
    b.hardens = smaller(b.tau_s - b.tau_y, room);
    b.do_harden = b.hardens > 0.0;
    b.d = where(b.do_harden, room, all(1.0));
    b.share = where(b.do_harden, b.hardens / b.d, all(1.0));
    return b;
  }

  [[gnu::always_inline]] Reduced reduced(Register y, Register ep, Register T_hat) const {
    const Branches b = branches(y, T_hat);
    const Register slower = larger(-y, all(0.0));
    const Register grown = exp_minus_1_of(c_.p * b.share);
    const Register strained = c_.p * c_.theta / (b.d * grown) * ep;
    const Register gone = -exp_minus_1_of(-strained);
    const Register left = 1.0 - gone;
    const Register sum = grown * gone;
    const Register hardened = log_of_1_plus(sum) * c_.inverse_p;
    const Register inverse_sum = 1.0 / (1.0 + sum);
    const Register bend = (1.0 + grown) * larger(gone - strained * left, all(0.0));
    const Register by_s = where(b.do_harden, bend * inverse_sum, all(1.0));
    const Register less = grown * strained * left * c_.inverse_p - (1.0 - b.share) * bend;
    const Register by_y = where(b.do_harden, 1.0 - hardened + less * inverse_sum, all(0.0));
    const Register stress = where(b.do_harden, b.tau_y + b.d * hardened, b.tau_s);
    const Register by_rate = larger(by_s * b.s_rate + by_y * b.y_rate, all(0.0));
    const Register sensitive = 1.0 - kSensitivity * slower;
    return {stress * sensitive, by_rate * sensitive + where(y < 0.0, kSensitivity * stress, all(0.0)),
            where(b.do_harden, c_.theta * left * inverse_sum * sensitive, all(0.0)),
            (by_s * b.s_T + by_y * b.y_T) * sensitive, b.branch};
  }

  // Which of the lanes `unknown` flow, and the starts of their searches.
  [[gnu::always_inline]] void start_from_rest(const Vertex& v, Register ep, Mask unknown, Search& root) const {
    const Register rest = reduced(v.log_slowest, ep, v.T_hat).stress;
    const Register above_rest = v.target - rest;
    const Mask yields = unknown & (above_rest > 0.0);
    const Mask room = rest < c_.s0;
    const Register share = above_rest / where(room, c_.s0 - rest, all(1.0));
    root.yields = (root.yields & without(unknown)) | yields;
    root.lo = where(unknown, v.log_slowest, root.lo);
    root.hi = where(unknown, all(0.0), root.hi);
    root.y = where(yields, v.log_slowest * (1.0 - share), root.y);
    root.moves |= yields;
    const Mask near_rest = yields & (above_rest <= c_.theta * c_.slowest_strain + kNearRest * v.target);
    if (lanes_where(near_rest) != 0) creep(v, ep, near_rest, root);
  }

  // dep of the vertices that flow more slowly than the slowest rate, where tau does not depend on the rate.
  [[gnu::always_inline]] void creep(const Vertex& v, Register ep, Mask near_rest, Search& root) const {
    const Register y = v.log_slowest;
    const Reduced slow = reduced(y, ep + c_.slowest_strain, v.T_hat);
    const Branches b = branches(y, v.T_hat);
    const Register grown = exp_minus_1_of(c_.p * b.share);
    const Register wanted = v.target / (1.0 + kSensitivity * y) - b.tau_y;
    const Register some_gone = exp_minus_1_of(c_.p * (wanted / b.d)) / grown;
    const Register gone = larger(smaller(some_gone, all(kMostGone)), all(0.0));
    const Register strain = log_of_1_plus(gone / (1.0 - gone)) * (b.d * grown / (c_.p * c_.theta));
    const Register flows = where(b.do_harden, larger(strain - ep, all(0.0)), all(0.0));
    const Mask creeps = near_rest & (slow.stress >= v.target);
    root.crept = smaller(flows, all(c_.slowest_strain));
    root.y = where(creeps, y, root.y);
    root.by_log_rate = where(creeps, all(0.0), root.by_log_rate);
    root.by_strain = where(creeps, slow.by_strain, root.by_strain);
    root.by_T_hat = where(creeps, slow.by_T_hat, root.by_T_hat);
    root.moves &= without(creeps);
    root.creeps |= creeps;
  }

  // Solves tau = target for y inside the bracket by Newton's method and inverse Hermite interpolation, as the law itself
  // does for one vertex. A lane that started from a guess and goes below its bracket becomes a suspect.
  [[gnu::always_inline]] void search(const Vertex& v, Register ep, Search& root) const {
    Register last_y{}, last_missing{}, last_inverse{}, last_branch = all(2.0 * kNoBranch);
    for (int iteration = 0; iteration < kMostIterations; ++iteration) {
      if (lanes_where(root.moves) == 0) break;
      const bool bisects = iteration >= kNewtonIterations && iteration % 2 == 0;
      const Mask moves = root.moves;
      const Register y = root.y, dep = short_exp_of(y + v.log_scale);
      const Reduced tau = reduced(y, ep + dep, v.T_hat);
      const Register missing = tau.stress - v.target;
      const Mask below = missing < 0.0;
      const Register lo = where(below, y, root.lo), hi = where(below, root.hi, y);
      const Register inverse = 1.0 / (tau.by_log_rate + tau.by_strain * dep);
      const Register newton = -missing * inverse;
      const Register apart = last_y - y, span = last_missing - missing;
      const Register u = missing / where(span == 0.0, all(1.0), -span);
      const Register a = span * inverse, b = span * last_inverse;
      const Register bend = u * u * ((3.0 * apart - 2.0 * a - b) + u * ((a + b) - 2.0 * apart));
      const Mask smooth = (tau.branch == last_branch) & (tau.branch > kNoBranch / 2.0);
      const Mask mild = smooth & (magnitude(bend) <= kMostBend * (newton * newton));
      const Register step = where(mild, newton + bend, newton);
      const Register tried = y + step;
      Mask inside = (tried < hi) & (tried > lo);
      if (bisects) inside &= without(inside);
      const Mask met = magnitude(missing) <= kRounding * v.target;
      const Register longest = where(mild, kArrivedByTwo / (magnitude(apart) + kArrivedByTwo / kSmooth), all(kArrived));
      const Mask arrived = (inside & (magnitude(step) <= longest)) | met | (hi - lo <= -2.0 * kRounding * lo);
      const Register next = where(met, y, where(inside, tried, 0.5 * (lo + hi)));
      const Mask left = moves & root.guessed & (tried <= v.log_slowest) & without(met);
      last_y = y;
      last_missing = missing;
      last_inverse = inverse;
      last_branch = tau.branch;
      root.lo = where(moves, lo, root.lo);
      root.hi = where(moves, hi, root.hi);
      root.y = where(moves, next, y);
      root.by_log_rate = where(moves, tau.by_log_rate, root.by_log_rate);
      root.by_strain = where(moves, tau.by_strain, root.by_strain);
      root.by_T_hat = where(moves, tau.by_T_hat, root.by_T_hat);
      root.suspect |= left;
      root.moves = moves & without(arrived) & without(left);
    }
  }

  [[gnu::always_inline]] VertexFlow answer(const Vertex& v, const LoadedVertex& at, const Search& root) const {
    const Register to_melting = where(v.solid, T_melt_ - at.T, T_melt_);
    const Register inverse_x = 1.0 / to_melting;
    const Register log_modulus = where(v.solid, -c_.alpha / (T_melt_ - c_.alpha * at.T), all(0.0));
    const Register log_g = where(v.solid, log_modulus - kMeltingFactor * T_melt_ * inverse_x * inverse_x, all(0.0));
    const Register searched = short_exp_of(smaller(root.y + v.log_scale, all(kMostLogStrain)));
    const Register dep = where(root.creeps, root.crept, searched);
    // The differential of tau = sqrt(3) a / (2 G0 g) is tau (dlna - dlng) = by_log_rate (dln(dep) - dln(scale)) +
    // by_strain ddep + by_T_hat dT^, with dT = rise dlna.
    const Register by_dep = root.by_log_rate + root.by_strain * dep;
    const Register pull = v.target * (1.0 - log_g * at.rise) + root.by_log_rate * (0.5 * log_modulus * at.rise) -
                          root.by_T_hat * (at.rise * inverse_T_melt_);
    const Register by_load = dep * (pull / larger(by_dep, kLeastSlope * v.target));
    return {where(root.yields, dep, all(0.0)), where(root.yields, by_load, all(0.0)), root.y, all(0.0)};
  }

  static constexpr double kSensitivity = PrestonTonksWallace::kRateSensitivity;
  PrestonTonksWallace::Constants c_;
  Register load_, T_melt_, inverse_T_melt_;
  Mask pressed_;
  Register bracket_;
};
