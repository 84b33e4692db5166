// The sums of laws whose strain increment is explicit; layer_flow_kernel.hpp includes this file.

// An expansion is used while |u| and |w| are at most kFarthest / exponent and growth |w| at most kReach.
inline constexpr double kFarthest = 0.02, kReach = 3e-3;
// In the first of these ranges a vertex with a growth below kSteep becomes hotter by the factor 1 + kHotter + kHotter
// growth at most: the exponent is at least 1.
inline constexpr double kSteep = 3.0, kHotter = 0.03;
// A vertex is left out only if it misses yielding by this factor, far above rounding: which vertices are left out
// depends on all lanes of a register, and must not change the bits of any.
inline constexpr double kMargin = 1.0 + 1e-9;
inline constexpr double kLeastLoad = 0x1p-1022;    // smallest stress  [Pa]
inline constexpr double kRoundedUp = 1.0 + 1e-12;  // so that a flux is as near as its stress in spite of rounding
inline constexpr double kUnlimited = 1e9;          // limit of a lane whose yielding vertices are not known
inline constexpr int kNewtonSteps = 2;             // of find_roots(); the balance is nearly linear in y
inline constexpr double kMostChange = 0.5;         // largest relative change of the series with which a root is of use

// The sums over the vertices.
struct Sums {
  Register slip{}, m0{}, m1{}, m2{}, m3{};

  // Adds a vertex, where `now` is its `hot` under the stress, and returns dep.
  [[gnu::always_inline]] Register add(const Expansion& at, Register now, Register cold, double weight) {
    const Register dep = larger(now - cold, Register{});
    const Register weighted = only(dep > 0.0, weight * at.hot);
    slip += weight * dep;
    m0 += weighted;
    m1 += weighted * at.c1;
    m2 += weighted * at.c2;
    m3 += weighted * at.c3;
    return dep;
  }
  [[gnu::always_inline]] Register change(Register w) const { return w * (m1 + w * (m2 + w * m3)); }
  [[gnu::always_inline]] Register steepness(Register w) const { return m1 + w * (2.0 * m2 + w * (3.0 * m3)); }

  [[gnu::always_inline]] void write(Register w, Register y, int lane, LayerFlow& flow) const {
    store(slip, flow.slip + lane);
    store(y * (flow.exponent * (m0 + change(w)) + (1.0 + w) * steepness(w)), flow.slope + lane);
    store(m0, flow.expanded.moment[0] + lane);
    store(m1, flow.expanded.moment[1] + lane);
    store(m2, flow.expanded.moment[2] + lane);
    store(m3, flow.expanded.moment[3] + lane);
  }
};

// Moves the lanes of a register to their loads: sets u, w and y; the base, where the expansion does not reach the load;
// origin and limit, where the vertices that can yield are not known under the load.
struct Following {
  bool reached;  // the expansions of all lanes reach their loads
  bool at_base;  // all lanes are at their base
  bool limited;  // the vertices that can yield are known in all lanes
};
[[gnu::always_inline]] inline Following follow(LayerFlow& flow, int lane) {
  ExpandedLoads& at = flow.expanded;
  const Register base = load(at.base + lane), stress = load(flow.stress + lane), origin = load(at.origin + lane);
  const Register heating = load(flow.heating + lane), base_heating = load(at.base_heating + lane);
  const Register flux = heating * stress, origin_flux = load(at.origin_flux + lane);
  const double farthest = kFarthest / flow.exponent;
  const Mask limited = (magnitude(stress - origin) <= farthest * origin) &
                       (magnitude(flux - origin_flux) <= farthest * kRoundedUp * origin_flux);
  const Register change = (stress - base) / larger(base, all(kLeastLoad));
  const Register more = (heating - base_heating) / larger(base_heating, all(kLeastLoad));
  const Register heated = change + more * (1.0 + change);
  const Mask near = limited & (magnitude(change) <= farthest) & (magnitude(heated) <= farthest) &
                    (magnitude(heated) * load(at.steepest + lane) <= kReach);
  const Register u = only(near, change), w = only(near, heated);
  store(u, at.u + lane);
  store(w, at.w + lane);
  store(power_of(1.0 + u, all(flow.exponent)), at.y + lane);
  store(where(near, base, stress), at.base + lane);
  store(where(near, base_heating, heating), at.base_heating + lane);
  store(where(limited, origin, stress), at.origin + lane);
  store(where(limited, origin_flux, flux), at.origin_flux + lane);
  store(where(limited, load(at.limit + lane), all(kUnlimited)), at.limit + lane);
  return {everywhere(near), everywhere((u == 0.0) & (w == 0.0)), everywhere(limited)};
}

// Number of vertices from z = 0 that a register needs, whose limits are known.
[[gnu::always_inline]] inline std::ptrdiff_t rows_within_limit(const ExpandedLoads& at, int lane) {
  double most = 0.0;
  for (int l = lane; l < lane + kWidth; ++l) most = at.limit[l] > most ? at.limit[l] : most;
  return static_cast<std::ptrdiff_t>(most);
}

// Finds the bounds of the lanes of a register.
[[gnu::noinline]] inline void find_bounds(LayerFlow& flow, int lane) {
  const FlowProblem& problem = flow.problem;
  FlowBounds& bounds = flow.expanded.bounds;
  std::ptrdiff_t i = problem.grid->num_vertices() - 1;
  Register T = load(problem.T_ad + i * kLanes + lane), strain = load(problem.strain + i * kLanes + lane), spread{};
  for (std::ptrdiff_t block = i / bounds.rows; block > 0; --block) {
    for (; i >= block * bounds.rows; --i) {
      const std::ptrdiff_t row = i * kLanes + lane;
      T = larger(T, load(problem.T_ad + row));
      strain = smaller(strain, load(problem.strain + row));
      if (problem.spread_response != nullptr) spread = larger(spread, load(problem.spread_response + row));
    }
    store(T, bounds.T_ad[block] + lane);
    store(strain, bounds.strain[block] + lane);
    store(spread, bounds.spread[block] + lane);
  }
  flow.bounds_known |= kAllOfRegister << lane;
}

// Expands the vertices of the lanes of a register about `base`, sums their flow there and writes the strain.
template <class Law, bool kSpread>
[[gnu::always_inline]] inline void expand(LayerFlow& flow, bool limited, int lane, double* strain_new) {
  const FlowProblem& problem = flow.problem;
  ExpandedLoads& at = flow.expanded;
  const FlowBounds& bounds = at.bounds;
  const Register base = load(at.base + lane);
  const Law law(*problem.soft, problem.dt, {base, load(flow.pressed + lane), load(flow.T_melt + lane)});
  const double fresh = Law::cold_without_strain(*problem.soft);
  const Register flux = load(at.base_heating + lane) * base, limit = load(at.limit + lane);
  const std::ptrdiff_t n = limited ? rows_within_limit(at, lane) : problem.grid->num_vertices();
  Register steepest{}, num_yielding{};
  Sums sums;
  std::ptrdiff_t i = 0;
  Mask inside = limit > 0.0, may_yield{};  // of the block: lanes whose limit is behind it; lanes with a vertex that may
  Register steepest_here{};                // of the block
  for (std::ptrdiff_t block = 1, end = std::min(n, bounds.rows); i < n;) {
    const std::ptrdiff_t row = i * kLanes + lane;
    const Register rise = flux * (kSpread ? load(problem.spread_response + row) : all(problem.response[i]));
    const Register T = load(problem.T_ad + row) + rise;
    const Register ep = load(problem.strain + row);
    const Register cold = fresh + ep;
    const Expansion vertex = law.expand(T, rise);
    double* kept = flow.rows_of_vertices + i * LayerFlow::kTerms * kLanes + lane;
    store(vertex.hot, kept);
    store(vertex.c1, kept + kLanes);
    store(vertex.c2, kept + std::ptrdiff_t{2} * kLanes);
    store(vertex.c3, kept + std::ptrdiff_t{3} * kLanes);
    store(ep + sums.add(vertex, vertex.hot, cold, problem.grid->weight[static_cast<std::size_t>(i)]), strain_new + row);
    // A vertex that yields nowhere in the first range of the expansion does not limit the second one.
    const Mask may = ((1.0 + kHotter + kHotter * kSteep) * vertex.hot >= cold) | (vertex.growth >= kSteep);
    may_yield |= may;
    steepest_here = larger(steepest_here, only(may, vertex.growth));
    if (++i != end) continue;
    const Register number = all(static_cast<double>(end));
    steepest = larger(steepest, only(inside, steepest_here));
    num_yielding = where(may_yield & inside, number, num_yielding);
    if (end == n) break;
    inside = number < limit;
    // A lane with a known limit needs all vertices up to it, whatever its stress now.
    const Mask skips = without(inside), open = (limit >= kUnlimited) & (vertex.growth < kSteep);
    const Register hottest = kMargin * vertex.hot * (1.0 + kHotter + kHotter * vertex.growth);
    if (!limited && everywhere((open & (hottest < cold)) | skips)) {
      if ((flow.bounds_known >> lane & kAllOfRegister) != kAllOfRegister) find_bounds(flow, lane);
      const Register most_rise = flux * (kSpread ? load(bounds.spread[block] + lane) : all(problem.response[end]));
      const Mask colder = (T >= load(bounds.T_ad[block] + lane) + most_rise) & (rise >= most_rise);
      const Mask harder = hottest < fresh + load(bounds.strain[block] + lane);
      if (everywhere((colder & harder & open) | skips)) break;
    }
    may_yield = Mask{};
    steepest_here = Register{};
    end = std::min(n, end + bounds.rows);
    ++block;
  }
  store(steepest, at.steepest + lane);
  sums.write(all(0.0), all(1.0), lane, flow);
  if (limited) return;
  store(where(limit < kUnlimited, limit, num_yielding), at.limit + lane);
  for (; i < n; ++i) store(load(problem.strain + i * kLanes + lane), strain_new + i * kLanes + lane);
}

// Sums the flow of the lanes of a register by their expansions, and writes the strain.
template <class Law>
[[gnu::always_inline]] inline void sum_expansions(LayerFlow& flow, int lane, double* strain_new) {
  const FlowProblem& problem = flow.problem;
  const Register w = load(flow.expanded.w + lane), y = load(flow.expanded.y + lane), yw = y * w;
  const double fresh = Law::cold_without_strain(*problem.soft);
  const std::ptrdiff_t n = rows_within_limit(flow.expanded, lane);
  Sums sums;
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const std::ptrdiff_t row = i * kLanes + lane;
    const double* kept = flow.rows_of_vertices + i * LayerFlow::kTerms * kLanes + lane;
    const Expansion at{load(kept),
                       load(kept + kLanes),
                       load(kept + std::ptrdiff_t{2} * kLanes),
                       load(kept + std::ptrdiff_t{3} * kLanes),
                       {}};
    const Register now = at.hot * (y + yw * (at.c1 + w * (at.c2 + w * at.c3)));
    const Register ep = load(problem.strain + row);
    store(ep + sums.add(at, now, fresh + ep, problem.grid->weight[static_cast<std::size_t>(i)]), strain_new + row);
  }
  sums.write(w, y, lane, flow);
}

template <class Law>
inline constexpr bool kIsExplicit = requires(const Law law, Register T) {
  law.expand(T, T);
};

template <class Law, bool kSpread>
requires(kIsExplicit<Law>)
    [[gnu::always_inline]] inline void sum_register(LayerFlow& flow, int lane, double* strain_new) {
  const Following following = follow(flow, lane);
  if (!following.reached) expand<Law, kSpread>(flow, following.limited, lane, strain_new);
  if (following.reached || !following.at_base) sum_expansions<Law>(flow, lane, strain_new);
}

// Newton's method for y, of which the flow is nearly a linear function.
inline void find_roots(const LayerFlow& flow, double compliance, const double* a_trial, double* root) {
  const ExpandedLoads& at = flow.expanded;
  const Register inverse_exponent = all(1.0 / flow.exponent);
  for (int lane = 0; lane < kLanes; lane += kWidth) {
    const Sums sums{load(flow.slip + lane), load(at.moment[0] + lane), load(at.moment[1] + lane),
                    load(at.moment[2] + lane), load(at.moment[3] + lane)};
    const Register base = load(at.base + lane);
    Register u = load(at.u + lane), y = load(at.y + lane);
    Register hot = sums.m0 + sums.change(u);
    const Register constant = (base - load(a_trial + lane)) + compliance * (sums.slip - y * hot);
    for (int step = 0; step < kNewtonSteps; ++step) {
      const Register open = base * u + (constant + compliance * (y * hot));
      const Register du_dy = inverse_exponent * (1.0 + u) / y;
      y = larger(y - open / (compliance * (hot + y * sums.steepness(u) * du_dy) + base * du_dy), all(kLeastLoad));
      u = exp_minus_1_of(inverse_exponent * log_of(y));
      hot = sums.m0 + sums.change(u);
    }
    const Mask reached = (sums.m0 > 0.0) & (magnitude(hot - sums.m0) <= kMostChange * sums.m0);
    store(where(reached, base * (1.0 + u), all(-1.0)), root + lane);
  }
}
