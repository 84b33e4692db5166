// The sums of laws whose strain increment is searched for at each vertex; layer_flow_kernel.hpp includes this file.

inline constexpr double kFarthestMove = 1.0;  // largest change of ln(a) along which a root is moved
inline constexpr double kMostMove = 3.0;      // largest change of a root along its slope

// Sums the lanes of one register.
template <class Law, bool kSpread>
requires(!kIsExplicit<Law>)
    [[gnu::always_inline]] inline void sum_register(LayerFlow& flow, int lane, double* strain_new) {
  const FlowProblem& problem = flow.problem;
  SearchedLoads& last = flow.searched;
  const Register stress = load(flow.stress + lane), flux = load(flow.heating + lane) * stress;
  const Law law(*problem.soft, problem.dt, {stress, load(flow.pressed + lane), load(flow.T_melt + lane)});
  // A lane under the load of the last sum keeps its flow: its bits must not depend on how often others are summed.
  Register moved{};  // relative change of the stress
  Mask stays{};
  if (last.summed) {
    const Register before = load(last.last_stress + lane);
    const Mask loaded = before > 0.0;
    const Register change = (stress - before) / where(loaded, before, all(1.0));
    moved = only(loaded, smaller(larger(change, all(-kFarthestMove)), all(kFarthestMove)));
    stays = (stress == before) & (flux == load(last.last_flux + lane));
    if (everywhere(stays)) return;
  }
  Register slip{}, slope{};
  Register nearer{}, near{};  // roots of the two vertices before
  Mask has_nearer{}, has_near{};
  const std::ptrdiff_t n = problem.grid->num_vertices();
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const std::ptrdiff_t row = i * kLanes + lane;
    double* kept = flow.rows_of_vertices + i * LayerFlow::kTerms * kLanes + lane;
    const Register rise = flux * (kSpread ? load(problem.spread_response + row) : all(problem.response[i]));
    LoadedVertex vertex{.T = load(problem.T_ad + row) + rise,
                        .rise = rise,
                        .ep = load(problem.strain + row),
                        .guess = where(has_nearer, near + (near - nearer), near),
                        .has_guess = has_near,
                        .wanted = without(stays),
                        .rest_is_known = last.summed};
    Register last_dep{}, last_by_load{};
    if (last.summed) {
      last_dep = load(kept + kLanes);
      last_by_load = load(kept + std::ptrdiff_t{2} * kLanes);
      vertex.rest = load(kept + std::ptrdiff_t{3} * kLanes);
      const Mask flowed = last_dep > 0.0;
      const Register along = moved * (last_by_load / where(flowed, last_dep, all(1.0)));
      vertex.guess = where(flowed, load(kept) + smaller(larger(along, all(-kMostMove)), all(kMostMove)), vertex.guess);
      vertex.has_guess |= flowed;
    }
    VertexFlow found = law.flow(vertex);
    if (last.summed) {
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
  store(stress, last.last_stress + lane);
  store(flux, last.last_flux + lane);
}
