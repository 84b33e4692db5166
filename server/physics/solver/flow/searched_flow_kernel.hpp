// The kernels of searched_flow.hpp; each_register.hpp includes this file once per register width.
#if SHEARBUS_WIDTH > 1
#include "server/physics/solver/flow/elementary_kernel.hpp"

// A vertex in each lane, before its search.
struct LoadedVertex {
  Register T, rise;  // temperature after the step, and the part of it that is due to the flux  [K]
  Register ep;       // plastic strain before the step
  Register guess;    // of the root, where has_guess is set
  Mask has_guess;
  Mask wanted;    // the flow of the lane is needed
  Register rest;  // strength at rest that the last sum kept
};

// The flow of a vertex. The root is the logarithm of dep, or of the rate of the law.
struct VertexFlow {
  Register dep, by_load;  // strain increment, and its derivative by ln(a)
  Register root;
  Register rest;  // strength at rest to keep
};

#include "server/physics/solver/flow/johnson_cook_kernel.hpp"
#include "server/physics/solver/flow/preston_tonks_wallace_kernel.hpp"

inline constexpr double kMostMove = 3.0;  // largest change of a root along its slope

// Sums the lanes of one register.
template <class Law, bool kSpread>
[[gnu::always_inline]] inline void sum_register(const FlowProblem& problem, const FlowLoad& at, int lane,
                                                double* strain_new, SearchedFlow& flow) {
  const Law law(*problem.soft, problem.dt, at, lane);
  const Register flux = load(at.flux + lane);
  // A lane under the load of the last sum keeps its flow: its bits must not depend on how often others are summed.
  Register moved{};
  Mask stays{};
  if (flow.summed) {
    const Register last_load = load(flow.last_load + lane);
    moved = law.moved_from(last_load);
    stays = (load(at.load + lane) == last_load) & (flux == load(flow.last_flux + lane));
    if (everywhere(stays)) return;
  }
  Register slip{}, slope{};
  Register nearer{}, near{};  // roots of the two vertices before
  Mask has_nearer{}, has_near{};
  const std::ptrdiff_t n = problem.grid->num_vertices();
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const std::ptrdiff_t row = i * kLanes + lane;
    const bool is_heated = i < problem.num_heated;
    double* kept = flow.rows + i * SearchedFlow::kTerms * kLanes + lane;
    LoadedVertex vertex;
    vertex.rise =
        is_heated ? flux * (kSpread ? load(problem.spread_response + row) : all(problem.response[i])) : all(0.0);
    vertex.T = load(problem.T_ad + row) + vertex.rise;
    vertex.ep = load(problem.strain + row);
    vertex.guess = where(has_nearer, near + (near - nearer), near);
    vertex.has_guess = has_near;
    vertex.wanted = without(stays);
    vertex.rest = Register{};
    Register last_dep{}, last_by_load{};
    if (flow.summed) {
      last_dep = load(kept + kLanes);
      last_by_load = load(kept + std::ptrdiff_t{2} * kLanes);
      vertex.rest = load(kept + std::ptrdiff_t{3} * kLanes);
      const Mask flowed = last_dep > 0.0;
      const Register along = moved * (last_by_load / where(flowed, last_dep, all(1.0)));
      vertex.guess = where(flowed, load(kept) + smaller(larger(along, all(-kMostMove)), all(kMostMove)), vertex.guess);
      vertex.has_guess |= flowed;
    }
    VertexFlow found = law.flow(vertex, flow.summed);
    if (flow.summed) {
      found.dep = where(stays, last_dep, found.dep);
      found.by_load = where(stays, last_by_load, found.by_load);
      found.root = where(stays, load(kept), found.root);
    }
    const double weight = problem.grid->weight[static_cast<std::size_t>(i)];
    slip += weight * found.dep;
    slope += weight * found.by_load;
    store(vertex.ep + found.dep, strain_new + row);
    store(found.root, kept);
    store(found.dep, kept + kLanes);
    store(found.by_load, kept + std::ptrdiff_t{2} * kLanes);
    store(found.rest, kept + std::ptrdiff_t{3} * kLanes);
    const Mask flows = found.dep > 0.0;
    nearer = near;
    has_nearer = has_near & flows;
    near = found.root;
    has_near = flows;
  }
  store(slip, flow.slip + lane);
  store(slope, flow.slope + lane);
}

template <class Law>
[[gnu::always_inline]] inline void sum_registers(const FlowProblem& problem, const FlowLoad& at, double* strain_new,
                                                 SearchedFlow& flow) {
  for (int lane = 0; lane < kLanes; lane += kWidth) {
    if (problem.spread_response == nullptr) {
      sum_register<Law, false>(problem, at, lane, strain_new, flow);
    } else {
      sum_register<Law, true>(problem, at, lane, strain_new, flow);
    }
  }
}

inline void sum_johnson_cook(const FlowProblem& problem, const FlowLoad& at, double* strain_new, SearchedFlow& flow) {
  sum_registers<JohnsonCookSearch>(problem, at, strain_new, flow);
}
inline void sum_preston_tonks_wallace(const FlowProblem& problem, const FlowLoad& at, double* strain_new,
                                      SearchedFlow& flow) {
  sum_registers<PrestonTonksWallaceSearch>(problem, at, strain_new, flow);
}

#endif
