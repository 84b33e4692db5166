// The kernel of expanded_flow.hpp for the law of Steinberg, Cochran and Guinan; each_register.hpp includes this file
// once per register width.
#if SHEARBUS_WIDTH > 1
#include "server/physics/solver/flow/elementary_kernel.hpp"

// An expansion is used while |u| and |w| are at most kFarthest / exponent and growth |w| at most kReach.
inline constexpr double kFarthest = 0.02, kReach = 3e-3;
// In the first of these ranges a vertex with a growth below kSteep becomes hotter by the factor 1 + kHotter + kHotter
// growth at most: the exponent is at least 1.
inline constexpr double kSteep = 3.0, kHotter = 0.03;
// A vertex is left out only if it misses yielding by this factor, far above rounding: which vertices are left out
// depends on all lanes of a register, and must not change the bits of any.
inline constexpr double kMargin = 1.0 + 1e-9;
inline constexpr double kLeastStress = 0x1p-1022;  // smallest stress that is a load, over the yield strength and in Pa
inline constexpr double kLeastToMelting = 1e-10, kLeastBracket = 1e-60;  // smallest T_melt - T [K], smallest bracket
inline constexpr double kRoundedUp = 1.0 + 1e-12;  // so that a flux is as near as its stress in spite of rounding
inline constexpr double kUnlimited = 1e9;          // limit of a lane whose yielding vertices are not known
inline constexpr int kNewtonSteps = 2;             // of find_roots(); the balance is nearly linear in y
inline constexpr double kMostChange = 0.5;         // largest relative change of the series with which a root is of use

// A vertex in each lane under the stress base (1 + u) and 1 + w times the flux of the base:
//   dep = max(0, (1 + u)^exponent hot (1 + c1 w + c2 w^2 + c3 w^3) - cold),   cold = 1 / beta + ep
// The terms left out are below (growth w)^4.
struct Vertex {
  Register hot, c1, c2, c3, growth;
};

// The law and the loads of the lanes of one register. Logarithms and excesses are binary.
struct Law {
  Register log_load, bracket, T_melt;
  double inverse_n, melting, hT, inverse_beta;

  [[gnu::always_inline]] Law(const Material& m, const StressLoad& at, int lane)
      : bracket(load(at.bracket + lane)),
        T_melt(load(at.T_melt + lane)),
        inverse_n(1.0 / m.hardening_exponent),
        melting(kMeltingFactor / m.hardening_exponent),
        hT(m.temperature_coefficient),
        inverse_beta(1.0 / m.hardening_coefficient) {
    const Register ratio = (kSqrt3 / m.yield_strength) * load(at.base + lane);
    const Mask loads = ratio > kLeastStress;
    const Register logarithm = inverse_n * log2_of(where(loads, ratio, all(1.0)));
    log_load = where(loads, logarithm + log2_of(all(inverse_beta)), all(kNoLoad));
  }

  // hot is exp(load + softening excess) / beta at T = T_ad + rise. At T_ad + (1 + w) rise the excess is a series in w:
  // the ratio of consecutive powers is f for its term -log(bracket) / n, and v for its term 0.001 T / (T_melt - T) / n.
  // A molten vertex is as hot as kMaxExcess permits.
  [[gnu::always_inline]] Vertex at(Register T, Register rise) const {
    const Register x = larger(T_melt - T, all(kLeastToMelting)), b = larger(bracket - hT * T, all(kLeastBracket));
    const SplitLogarithm log_b(b);
    // One division yields 1 / x, 1 / b and the division of the logarithm.
    const Register divisor = 2.0 + log_b.f;
    const Register xb = x * b;
    const Register inverse = 1.0 / (xb * divisor);
    const Register inverse_xb = divisor * inverse;
    const Register inverse_x = b * inverse_xb;
    const Register excess = (kLog2E * melting) * T * inverse_x - inverse_n * log_b.value(log_b.f * (xb * inverse));
    const Register hot = exp2_of(log_load + excess, kLog2E * kMaxExcess);
    const Register f = hT * rise * x * inverse_xb, v = rise * inverse_x;
    const Register f1 = inverse_n * f, v1 = melting * T_melt * inverse_x * v;
    const Register f2 = f1 * f, v2 = v1 * v;
    const Register s1 = f1 + v1, s2 = 0.5 * f2 + v2, s3 = (1.0 / 3.0) * (f2 * f) + v2 * v;
    const Register square = s1 * s1;
    return {hot, s1, 0.5 * square + s2, s1 * ((1.0 / 6.0) * square + s2) + s3, s1 + v};
  }
};

// The sums over the vertices.
struct Sums {
  Register slip{}, m0{}, m1{}, m2{}, m3{};

  // Adds a vertex, where `now` is its `hot` under the stress, and returns dep.
  [[gnu::always_inline]] Register add(const Vertex& at, Register now, Register cold, double weight) {
    const Register dep = larger(now - cold, Register{});
    const Register weighted = (Register)((Bits)(weight * at.hot) & (Bits)(dep > 0.0));
    slip += weight * dep;
    m0 += weighted;
    m1 += weighted * at.c1;
    m2 += weighted * at.c2;
    m3 += weighted * at.c3;
    return dep;
  }
  [[gnu::always_inline]] Register change(Register w) const { return w * (m1 + w * (m2 + w * m3)); }
  [[gnu::always_inline]] Register steepness(Register w) const { return m1 + w * (2.0 * m2 + w * (3.0 * m3)); }

  [[gnu::always_inline]] void write(Register w, Register y, int lane, ExpandedFlow& flow) const {
    store(slip, flow.slip + lane);
    store(y * (flow.exponent * (m0 + change(w)) + (1.0 + w) * steepness(w)), flow.slope + lane);
    store(m0, flow.moment[0] + lane);
    store(m1, flow.moment[1] + lane);
    store(m2, flow.moment[2] + lane);
    store(m3, flow.moment[3] + lane);
  }
};

// Moves the lanes of a register to their loads: sets u, w and y; the base, where the expansion does not reach the load;
// origin and limit, where the vertices that can yield are not known under the load.
struct Following {
  bool reached;  // the expansions of all lanes reach their loads
  bool at_base;  // all lanes are at their base
  bool limited;  // the vertices that can yield are known in all lanes
};
[[gnu::always_inline]] inline Following follow(StressLoad& at, int lane, ExpandedFlow& flow) {
  const Register base = load(at.base + lane), stress = load(at.stress + lane), origin = load(flow.origin + lane);
  const Register heating = load(at.heating + lane), base_heating = load(at.base_heating + lane);
  const Register flux = heating * stress, origin_flux = load(flow.origin_flux + lane);
  const double farthest = kFarthest / flow.exponent;
  const Mask limited = (magnitude(stress - origin) <= farthest * origin) &
                       (magnitude(flux - origin_flux) <= farthest * kRoundedUp * origin_flux);
  const Register change = (stress - base) / larger(base, all(kLeastStress));
  const Register more = (heating - base_heating) / larger(base_heating, all(kLeastStress));
  const Register heated = change + more * (1.0 + change);
  const Mask near = limited & (magnitude(change) <= farthest) & (magnitude(heated) <= farthest) &
                    (magnitude(heated) * load(flow.steepest + lane) <= kReach);
  const Register u = where(near, change, all(0.0)), w = where(near, heated, all(0.0));
  store(u, flow.u + lane);
  store(w, flow.w + lane);
  store(exp2_of(flow.exponent * log2_of(1.0 + u)), flow.y + lane);
  store(where(near, base, stress), at.base + lane);
  store(where(near, base_heating, heating), at.base_heating + lane);
  store(where(limited, origin, stress), flow.origin + lane);
  store(where(limited, origin_flux, flux), flow.origin_flux + lane);
  store(where(limited, load(flow.limit + lane), all(kUnlimited)), flow.limit + lane);
  return {everywhere(near), everywhere((u == 0.0) & (w == 0.0)), everywhere(limited)};
}

// Expands the vertices of the lanes of a register about `base`, sums their flow there and writes the strain.
template <bool kSpread>
[[gnu::always_inline]] inline void expand(const FlowProblem& problem, const StressLoad& at, bool limited, int lane,
                                          double* strain_new, ExpandedFlow& flow) {
  const Law law(*problem.soft, at, lane);
  const FlowBounds& bounds = flow.bounds;
  const Register flux = load(at.base_heating + lane) * load(at.base + lane), limit = load(flow.limit + lane);
  const std::ptrdiff_t n = limited ? flow.num_rows[lane] : problem.grid->num_vertices();
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
    const Register cold = law.inverse_beta + ep;
    const Vertex vertex = law.at(T, rise);
    double* kept = flow.rows + i * ExpandedFlow::kTerms * kLanes + lane;
    store(vertex.hot, kept);
    store(vertex.c1, kept + kLanes);
    store(vertex.c2, kept + std::ptrdiff_t{2} * kLanes);
    store(vertex.c3, kept + std::ptrdiff_t{3} * kLanes);
    store(ep + sums.add(vertex, vertex.hot, cold, problem.grid->weight[static_cast<std::size_t>(i)]), strain_new + row);
    // A vertex that yields nowhere in the first range of the expansion does not limit the second one.
    const Mask may = ((1.0 + kHotter + kHotter * kSteep) * vertex.hot >= cold) | (vertex.growth >= kSteep);
    may_yield |= may;
    steepest_here = larger(steepest_here, (Register)((Bits)vertex.growth & (Bits)may));
    if (++i != end) continue;
    const Register number = all(static_cast<double>(end));
    steepest = larger(steepest, (Register)((Bits)steepest_here & (Bits)inside));
    num_yielding = where(may_yield & inside, number, num_yielding);
    if (end == n) break;
    inside = number < limit;
    if (!limited) {
      const Register most_rise = flux * (kSpread ? load(bounds.spread[block] + lane) : all(problem.response[end]));
      const Mask colder = (T >= load(bounds.T_ad[block] + lane) + most_rise) & (rise >= most_rise);
      const Register hottest = vertex.hot * (1.0 + kHotter + kHotter * vertex.growth);
      const Mask harder = hottest * kMargin < law.inverse_beta + load(bounds.strain[block] + lane);
      // A lane with a known limit needs all vertices up to it, whatever its stress now.
      const Mask unknown = limit >= kUnlimited;
      if (everywhere((colder & harder & (vertex.growth < kSteep) & unknown) | without(inside))) break;
    }
    may_yield = Mask{};
    steepest_here = Register{};
    end = std::min(n, end + bounds.rows);
    ++block;
  }
  store(steepest, flow.steepest + lane);
  sums.write(all(0.0), all(1.0), lane, flow);
  if (limited) return;
  store(where(limit < kUnlimited, limit, num_yielding), flow.limit + lane);
  double most = 0.0;
  for (int l = lane; l < lane + kWidth; ++l) most = flow.limit[l] > most ? flow.limit[l] : most;
  flow.num_rows[lane] = static_cast<std::ptrdiff_t>(most);
  for (; i < n; ++i) store(load(problem.strain + i * kLanes + lane), strain_new + i * kLanes + lane);
}

// Sums the flow of the lanes of a register by their expansions, and writes the strain.
[[gnu::always_inline]] inline void sum(const FlowProblem& problem, int lane, double* strain_new, ExpandedFlow& flow) {
  const Register w = load(flow.w + lane), y = load(flow.y + lane), yw = y * w;
  const double inverse_beta = 1.0 / problem.soft->hardening_coefficient;
  Sums sums;
  for (std::ptrdiff_t i = 0; i < flow.num_rows[lane]; ++i) {
    const std::ptrdiff_t row = i * kLanes + lane;
    const double* kept = flow.rows + i * ExpandedFlow::kTerms * kLanes + lane;
    const Vertex at{load(kept),
                    load(kept + kLanes),
                    load(kept + std::ptrdiff_t{2} * kLanes),
                    load(kept + std::ptrdiff_t{3} * kLanes),
                    {}};
    const Register now = at.hot * (y + yw * (at.c1 + w * (at.c2 + w * at.c3)));
    const Register ep = load(problem.strain + row);
    store(ep + sums.add(at, now, inverse_beta + ep, problem.grid->weight[static_cast<std::size_t>(i)]),
          strain_new + row);
  }
  sums.write(w, y, lane, flow);
}

inline void sum_flow(const FlowProblem& problem, StressLoad& at, double* strain_new, ExpandedFlow& flow) {
  for (int lane = 0; lane < kLanes; lane += kWidth) {
    const Following following = follow(at, lane, flow);
    if (!following.reached && problem.spread_response == nullptr) {
      expand<false>(problem, at, following.limited, lane, strain_new, flow);
    } else if (!following.reached) {
      expand<true>(problem, at, following.limited, lane, strain_new, flow);
    }
    if (following.reached || !following.at_base) sum(problem, lane, strain_new, flow);
  }
}

// Newton's method for y, of which the flow is nearly a linear function.
inline void find_roots(const ExpandedFlow& flow, const StressLoad& at, double compliance, const double* a_trial,
                       double* root) {
  const double inverse_exponent = 1.0 / flow.exponent;
  for (int lane = 0; lane < kLanes; lane += kWidth) {
    const Sums sums{load(flow.slip + lane), load(flow.moment[0] + lane), load(flow.moment[1] + lane),
                    load(flow.moment[2] + lane), load(flow.moment[3] + lane)};
    const Register base = load(at.base + lane);
    Register u = load(flow.u + lane), y = load(flow.y + lane);
    Register hot = sums.m0 + sums.change(u);
    const Register constant = (base - load(a_trial + lane)) + compliance * (sums.slip - y * hot);
    for (int step = 0; step < kNewtonSteps; ++step) {
      const Register open = base * u + (constant + compliance * (y * hot));
      const Register du_dy = inverse_exponent * (1.0 + u) / y;
      y = larger(y - open / (compliance * (hot + y * sums.steepness(u) * du_dy) + base * du_dy), all(kLeastStress));
      u = exp2_minus_1_of(inverse_exponent * log2_of(y));
      hot = sums.m0 + sums.change(u);
    }
    const Mask reached = (sums.m0 > 0.0) & (magnitude(hot - sums.m0) <= kMostChange * sums.m0);
    store(where(reached, base * (1.0 + u), all(-1.0)), root + lane);
  }
}

inline void find_bounds(const FlowProblem& problem, FlowBounds& bounds) {
  const std::ptrdiff_t n = problem.grid->num_vertices();
  bounds.rows = (n + FlowBounds::kBlocks - 1) / FlowBounds::kBlocks;
  for (int lane = 0; lane < kLanes; lane += kWidth) {
    std::ptrdiff_t i = n - 1;
    Register T = load(problem.T_ad + i * kLanes + lane), strain = load(problem.strain + i * kLanes + lane);
    Register spread{};
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
  }
}

#endif
