#include "server/physics/solver/velocity_driven/balance.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>

#include "server/physics/solver/flow/heated.hpp"
#include "server/physics/solver/flow/layer_flow.hpp"
#include "server/physics/solver/flow/plastic_heat.hpp"
#include "server/physics/solver/lane_step.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/step_operators.hpp"
#include "server/physics/solver/velocity_driven/elastic_trial.hpp"
#include "server/physics/solver/velocity_driven/mean_stress.hpp"
#include "server/physics/solver/velocity_driven/sliding.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

constexpr double kBeyond = 1e-10;  // relative margin added to an upper bound of the stress, against rounding
// If the flow relieves more than this multiple of the trial stress, Newton works on the logarithm of the flow.
constexpr double kFarAbove = 100.0;
constexpr double kLeastGuess = 1e-12;  // smallest useful starting stress, relative to the upper end of the bracket
// After this number of iterations every second one bisects; Newton usually needs fewer.
constexpr int kNewtonIterations = 16;
constexpr int kMaxIterations = 300;  // largest number of iterations of a lane (node); one that needs more has failed

// The stress from which the step starts. With INTERFACE_SLIP the jump is slip of the interface: the stress starts at
// the yield stress when slip begins, and again when the jump turns against the stress (DLP, section 5.2).
double starting_stress(const Problem& problem, double s_old, double jump, double pressure, double T0, double ep0) {
  if (problem.options.drive == Drive::kLayerShear || jump == 0.0 || (s_old < 0.0 && jump < 0.0) ||
      (s_old > 0.0 && jump > 0.0))
    return s_old;
  return std::copysign(flow_stress(problem.options.soft, ep0, pressure, T0) / kSqrt3, jump);
}

// Finds trial stress, direction, heating and the bracket of the stress of one lane. `rate`: change of the stress in the
// last step over its length, with which the search starts  [Pa/s]. `contact`: null where the limit neither depends on slip
// nor has a state.
Lane prepare(const Problem& problem, const Material& soft, const TileInputs& inputs, int lane, double dt,
             const Heated& heated, double s_start, double rate, const double* strain, const Sliding* contact) {
  const double h = problem.options.grid.thickness;
  const double pressure = inputs.pressure[lane];
  const ElasticTrial trial = elastic_trial(problem, soft, inputs, lane, dt, s_start);
  Lane state;
  state.direction = trial.direction;
  if (trial.stress == 0.0) return state;
  state.loaded = true;
  state.a_trial = std::abs(trial.stress);
  state.heating = trial.heating;

  // The upper end of the bracket is the smallest of several bounds. The first is the elastic trial stress.
  state.hi = state.a_trial;
  // Ceiling: the stress a = Y_max g(T) / sqrt(3) of the hottest vertex, which the stress itself heats; with g = 0 the
  // layer carries no stress.
  const double strongest = strength_ceiling(soft) / kSqrt3;
  const int hottest_ad = heated.hottest(0.0);
  const double T_hottest = heated.T(hottest_ad, 0.0);
  state.hottest = hottest_ad;
  if (!carries_stress(soft, pressure, T_hottest)) {
    state.hi = 0.0;
    state.bound = Bound::kCeiling;
  } else if (std::isfinite(strongest)) {
    StressLimit limit{std::numeric_limits<double>::infinity(), strongest, pressure, &soft};
    limit.effort = inputs.effort;
    const double ceiling =
        ceiling_stress(limit, heated, {0.0, 1.0, state.heating, 0.0}, state.hi, std::abs(s_start), state.hottest);
    if (ceiling < state.hi) {
      state.hi = ceiling;
      state.bound = Bound::kCeiling;
    }
  }
  if (const double rubbing = limit_without_slip(problem, soft, pressure, inputs.velocity_jump[lane], heated, state,
                                                contact, std::abs(s_start));
      rubbing < state.hi) {
    state.hi = rubbing;
    state.bound = Bound::kContact;
  }
  // Two more bounds of the bracket from above, which are never answers: above the first the hottest vertex alone would
  // flow by more than the whole slip; above the second a vertex would be molten. An explicit flow is solved from a good
  // guess without the first, unless melting is near.
  const auto inside = [&](double a) { return a > kLeastGuess * state.hi && a < state.hi; };
  const double last = state.direction * s_start, extrapolated = state.direction * (s_start + rate * dt);
  const auto guess = [&] { return inside(extrapolated) ? extrapolated : last; };
  const bool guessed = inside(guess());
  if (state.hi > 0.0 && hardens(soft)) {
    double beyond = std::numeric_limits<double>::infinity();
    if (!guessed || !has_explicit_flow(soft.flow_law) || !is_far_from_melting(soft, T_hottest)) {
      const double most_strain =
          h * state.a_trial / (kSqrt3 * soft.shear_modulus) / problem.grid.weight[static_cast<std::size_t>(hottest_ad)];
      const double all_at_hottest = hardened_strength(soft, strain[std::ptrdiff_t{hottest_ad} * kLanes] + most_strain,
                                                      most_strain / dt, pressure, T_hottest) *
                                    softening(soft, pressure, T_hottest).g / kSqrt3;
      beyond = all_at_hottest * (1.0 + kBeyond);
    }
    for (int i = 0; i < heated.candidates && state.heating > 0.0; ++i) {
      beyond = std::min(beyond, (soft.melting_temperature - heated.T(i, 0.0)) / (state.heating * heated.response(i)));
    }
    if (beyond < state.hi) {
      state.hi = beyond;
      state.bound = Bound::kNotAnAnswer;
    }
  }
  const double outermost = state.bound == Bound::kNotAnAnswer ? 0.5 * state.hi : state.hi;
  state.a = inside(guess()) ? guess() : outermost;
  return state;
}

// Narrows the bracket of a lane after the flow under `lane.a` has been summed. Sets `done` where the search ends:
// at the upper end of the bracket, at the root to the last digit, or because the bracket has closed. Returns whether the
// lane has its next stress, or none is needed.
bool narrow(Lane& lane, double flow, double left) {
  if (flow < left) {
    if (lane.a == lane.hi && !lane.hi_seen) {
      lane.at_bound = true;
      lane.done = true;
      return true;
    }
    lane.lo = lane.a;
  } else {
    lane.at_bound = flow == left && lane.a == lane.hi && !lane.hi_seen;
    lane.hi = lane.a;
    lane.hi_seen = true;
    if (flow == left) {
      lane.done = true;
      return true;
    }
  }
  if (lane.hi - lane.lo <= 2.0 * std::numeric_limits<double>::epsilon() * lane.hi) {
    // If the bracket closed at an upper bound that has not been evaluated, this bound is evaluated next.
    const bool unseen_bound = !lane.hi_seen && lane.bound != Bound::kNotAnAnswer;
    if (unseen_bound) lane.a = lane.hi;
    lane.done = !unseen_bound;
    return true;
  }
  return false;
}

// The stress that Newton's method on F tries next; F is nearly linear over the strain of one step. If the flow relieves
// far more than the trial stress, it is a high power of the stress, and the method works on the logarithm of the flow.
double newton(const Lane& lane, double compliance, double slip, double slope, double flow, double left) {
  if (flow > kFarAbove * lane.a_trial) return lane.a * (1.0 - logarithm(flow / lane.a_trial) * slip / slope);
  return lane.a - (flow - left) / (compliance * slope / lane.a + 1.0);
}

// Keeps the next stress inside the bracket. Tries its upper end itself if this bound can be the answer.
void go_on_with(Lane& lane, double next, double flow, int iteration) {
  const bool bisect = iteration >= kNewtonIterations && iteration % 2 == 0;
  const bool answer_at_hi = !lane.hi_seen && lane.bound != Bound::kNotAnAnswer;
  if (answer_at_hi && (flow == 0.0 || next >= lane.hi)) {
    lane.a = lane.hi;
  } else {
    lane.a = !bisect && next > lane.lo && next < lane.hi ? next : 0.5 * (lane.lo + lane.hi);
  }
}

// Finds the roots of the balances of all lanes together. The answer of a lane is a stress at which the flow was summed:
// each sum writes the strain, so that strain, temperature and stress belong together. A last step without a sum would
// not do: near melting the flow stress changes by far more than the stress.
void find_roots(LayerFlow& flow, const TileInputs& inputs, double compliance, Lane (&lanes)[kLanes],
                double* strain_new) {
  alignas(64) double a_trial[kLanes], root[kLanes];
  for (int l = 0; l < kLanes; ++l) a_trial[l] = lanes[l].a_trial;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    flow.sum(kAllLanes, strain_new);
    if (inputs.effort != nullptr) ++inputs.effort->layer_sums;
    std::uint32_t asks = 0;  // lanes that need another stress
    bool all_done = true;
    for (int l = 0; l < kLanes; ++l) {
      Lane& lane = lanes[l];
      if (lane.done) continue;
      ++lane.sums;
      const double left = lane.a_trial - lane.a;
      if (!narrow(lane, compliance * flow.slip[l], left)) {
        lane.done = is_balanced(lane.a, left, compliance, flow.slip[l], flow.accuracy(l));
        if (!lane.done) asks |= 1u << l;
      }
      all_done = all_done && lane.done;
    }
    if (all_done) break;
    flow.find_roots(asks, compliance, a_trial, root);
    for (int l = 0; l < kLanes; ++l) {
      Lane& lane = lanes[l];
      if (contains(asks, l)) {
        const double layer_flow = compliance * flow.slip[l], left = lane.a_trial - lane.a;
        double next = root[l];
        if (!(next > 0.0) && layer_flow > 0.0 && lane.a > 0.0)
          next = newton(lane, compliance, flow.slip[l], flow.slope[l], layer_flow, left);
        go_on_with(lane, next, layer_flow, iteration);
      }
      flow.load(l, lane.a, lane.heating);
    }
  }
}

// The mean stress of a step whose balance is solved, signed  [Pa]. `friction`: limit of the interface at the temperature
// before the step. `slips`: slip of layer and interface in the step.
double mean_stress(const Problem& problem, const Material& soft, const TileInputs& inputs, int l, const Lane& lane,
                   double dt, double s_start, const double* committed, const double* trial, double friction,
                   bool slips) {
  const TileLayout& layout = problem.layout;
  const StressPath path{lane.direction * s_start, lane.a_trial, lane.loaded ? lane.a : 0.0};
  if (!slips) return lane.direction * mean_of(path);
  const double pressure = inputs.pressure[l];
  const FlowedLayer layer{committed + layout.temperature + l, committed + layout.plastic_strain + l,
                          trial + layout.plastic_strain + l};
  return lane.direction * mean_of(path, onset_of_flow(problem.grid, soft, pressure, dt, layer, friction));
}

struct Answer {
  double slip;  // sliding velocity [v], signed  [m/s]
  Regime regime;
};

// Computes the sliding velocity [v] and the regime from the solved balance.
Answer answer_of(const Problem& problem, const Material& soft, const Lane& lane, double layer_slip,
                 double interface_slip, double T_hottest, double jump, double drive, double dt) {
  const bool flows = layer_slip > 0.0 || interface_slip > 0.0;
  double slip = lane.direction * (kSqrt3 * layer_slip / dt + interface_slip / dt);
  bool slips = flows;
  if (problem.options.drive == Drive::kInterfaceSlip) {
    // Slip at z = 0: DLP (64) with its signs corrected. The slip is along the jump or 0, and never against the stress.
    const double along = jump < 0.0 ? -1.0 : 1.0;
    const double at_interface = along * (jump + drive) - along * lane.direction * kSqrt3 * layer_slip / dt;
    slip = lane.direction * along < 0.0 || jump == 0.0 ? 0.0 : along * std::max(0.0, at_interface);
    slips = flows || slip != 0.0;
  }
  if (!slips) return {slip, Regime::kStick};
  if (lane.at_bound && lane.bound == Bound::kContact) return {slip, Regime::kCoulomb};
  return {slip, yielding_regime(soft, T_hottest)};
}

}  // namespace

void solve_balance(const Problem& problem, const StepOperators& operators, const BalanceStage& stage,
                   const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const Material& soft = problem.options.soft;
  const Grid& grid = problem.grid;
  const HeatOperator& heat = *stage.heat;
  const double* B = heat.layer_response();
  const double dt = stage.dt;
  const double h = problem.options.grid.thickness;
  const double compliance = kSqrt3 * soft.shear_modulus / h;  // fall of the stress per slip integral(dep)  [Pa/m]
  const bool layer_hardens = hardens(soft);
  bool loaded = false;  // at least one lane has a trial stress other than 0; otherwise nothing flows
  const double* strain = committed + layout.plastic_strain;
  double* strain_new = trial + layout.plastic_strain;
  double* T = trial + layout.temperature;
  // If the hard body conducts, or the second stage of SDIRK2 extrapolates the temperatures, the hottest vertex may lie
  // inside the layer.
  const bool hottest_inside =
      problem.options.hard_grid || problem.options.time_integrator != TimeIntegrator::kBackwardEuler;
  const int candidates = hottest_inside ? grid.num_vertices() : 1;

  // 1. Compute the temperatures T_ad, after conduction without friction heat: DLP (28-35).
  double* T_all = trial + layout.first_temperature();
  if (stage.early_flux == nullptr)
    conduct(heat, problem.heat_grid.num_vertices(), committed + layout.first_temperature(), T_all);

  // 2. Where the heat of the step is released: at z = 0, or distributed as the layer flowed in the last step with slip.
  // Part 4 finds how much heat is released.
  const bool spreads = layout.heat_shape != TileLayout::kAbsent;
  const double* shape = spreads ? committed + layout.heat_shape : nullptr;
  double* B_spread = spreads ? trial + layout.heat_shape : nullptr;  // response B_phi to this heat, until part 5
  if (spreads) respond(heat, operators.spread(), shape, B_spread);
  const auto heated = [&](int l) {
    return spreads ? Heated{T + l, B_spread + l, kLanes, candidates} : Heated{T + l, B, 1, candidates};
  };

  // 3. Trial stress and bracket of each lane: DLP (37), (56).
  Lane lanes[kLanes];
  double s_start[kLanes] = {};
  const LaneMaterials soft_at(soft, inputs);
  std::optional<Contacts> contacts;
  if (limit_follows_slip(problem)) contacts.emplace();
  for (int l = 0; l < kLanes; ++l) {
    const bool active = contains(inputs.active, l);
    const double pressure = active ? inputs.pressure[l] : 0.0;
    Sliding* contact = contacts ? &(*contacts)[l] : nullptr;
    if (active && contact != nullptr) {
      contact->state = contact_before(problem, committed, l);
      contact->limit = contact_limit(problem, soft_at(l), pressure, dt, contact->state, inputs.effort);
      contact->stuck = layout.sticking != TileLayout::kAbsent && committed[layout.sticking + l] != 0.0;
    }
    if (active && pressure > 0.0) {
      s_start[l] = starting_stress(problem, stress_before(layout, inputs, committed, l), inputs.velocity_jump[l],
                                   pressure, committed[layout.temperature + l], strain[l]);
      lanes[l] = prepare(problem, soft_at(l), inputs, l, dt, heated(l), s_start[l], committed[layout.stress_rate + l],
                         strain + l, contact);
      if (contact != nullptr) {
        contact->T_ad = T[l];
        contact->T_per_stress = lanes[l].heating * heated(l).response(0);
      }
    }
    lanes[l].done = !lanes[l].loaded;
    loaded = loaded || lanes[l].loaded;
    if (lanes[l].loaded && (!layer_hardens || lanes[l].hi == 0.0)) {  // the answer is the upper end of the bracket
      lanes[l].a = lanes[l].hi;
      lanes[l].at_bound = true;
      lanes[l].done = true;
    }
  }

  // 4. The root of the balance with the heat law q = beta_T max(s [V], 0) and the plastic flow, DLP (42-48).
  double slip[kLanes] = {};
  Contacts* slides = contacts && problem.options.drive == Drive::kLayerShear ? &*contacts : nullptr;
  if (layer_hardens && loaded) {
    LayerFlow flow({&soft, &grid, B, T, strain, dt, B_spread},
                   scratch_tile(Scratch::kFlow, LayerFlow::size_of_rows(grid)));
    for (int l = 0; l < kLanes; ++l) {
      const double pressure = contains(inputs.active, l) ? inputs.pressure[l] : 0.0;
      flow.load(l, soft_at(l), pressure, lanes[l].a, lanes[l].heating);
    }
    find_roots(flow, inputs, compliance, lanes, strain_new);
    if (slides != nullptr) slide(&flow, compliance, dt, lanes, *slides, strain_new);
    std::copy_n(flow.slip, kLanes, slip);
  } else {
    std::copy_n(strain, static_cast<std::size_t>(grid.num_vertices()) * kLanes, strain_new);
    if (slides != nullptr) slide(nullptr, compliance, dt, lanes, *slides, strain_new);
  }

  double flux_of[kLanes];
  for (int l = 0; l < kLanes; ++l) flux_of[l] = lanes[l].heating * lanes[l].a;

  // 5. Add the heat of this step to the temperatures: T = T_ad + q B, or T_ad + q B_phi if the layer releases the heat.
  if (spreads) {
    add_spread(heat, operators.spread(), flux_of, B_spread, T_all);
    std::copy_n(shape, static_cast<std::size_t>(grid.num_vertices()) * kLanes, B_spread);
  } else {
    add_flux(heat, problem.heat_grid.num_vertices(), flux_of, T_all);
  }

  // 6. The part of the slip that neither elastic shear nor plastic flow has taken: at the ceiling stress the hottest
  // vertex flows by this part, at the friction limit mu P the interface slips by it.
  const double weight = flow_work(soft.flow_law);
  for (const int l : lanes_of(inputs.active)) {
    const Lane& lane = lanes[l];
    double layer_slip = slip[l];
    double interface_slip = 0.0;  // slip of the interface in the step  [m]
    if (lane.at_bound && lane.bound != Bound::kElastic) {
      const double surplus = std::max(0.0, (lane.a_trial - lane.a) / compliance - layer_slip);
      if (lane.bound == Bound::kCeiling) {
        const double own = slides != nullptr ? std::min(surplus, (*contacts)[l].ceiling_slip * dt / kSqrt3) : 0.0;
        strain_new[lane.hottest * kLanes + l] += (surplus - own) / grid.weight[static_cast<std::size_t>(lane.hottest)];
        layer_slip += surplus - own;
        interface_slip = kSqrt3 * own;
      } else {
        interface_slip = kSqrt3 * surplus;
      }
    }

    // 7. The answers to the host.
    add_work(inputs, l, problem.heat_grid.num_vertices() + weight * (lane.sums + 1.0) * grid.num_vertices());
    const double jump = inputs.velocity_jump[l];
    const bool open = inputs.pressure[l] <= 0.0;
    const double T_hottest = heated(l).T(heated(l).hottest(0.0), 0.0);
    // If no root was found the stress is NaN, from which the caller concludes that the lane has failed (kFailed).
    const double found = lane.done ? lane.a : std::numeric_limits<double>::quiet_NaN();
    double s = lane.loaded ? lane.direction * found : 0.0;
    Answer answer = open ? Answer{jump, Regime::kOpen}
                         : answer_of(problem, soft_at(l), lane, layer_slip, interface_slip, T_hottest, jump,
                                     driving_velocity(problem, inputs, l), dt);
    std::uint8_t outcome = outside_domain(answer.slip, jump);
    double friction = std::numeric_limits<double>::infinity();  // limit of the interface at the old temperature
    if (contacts) {
      Sliding& own = (*contacts)[l];
      const bool known = open || problem.options.drive == Drive::kInterfaceSlip;
      const double v = known ? std::abs(jump) : interface_slip / dt;
      if (own.ceiling_slip > 0.0 && interface_slip > 0.0) answer.regime = Regime::kCoulomb;
      if (answer.regime == Regime::kCoulomb) answer.regime = slip_regime(own.limit, T[l], v);
      friction = own.limit.at(committed[layout.temperature + l], v).stress;
      if (own.several) outcome |= kMultipleRoots;
      if (!advance_contact(own.limit, v, T[l], own.state)) s = std::numeric_limits<double>::quiet_NaN();
      store_contact(problem, own.state, trial, l);
      if (layout.sticking != TileLayout::kAbsent) trial[layout.sticking + l] = open || v > 0.0 ? 0.0 : 1.0;
    } else if (inputs.wants_mean_stress && !open) {
      friction = interface_strength(problem.interface, soft_at(l), inputs.pressure[l], nullptr)
                     .friction(committed[layout.temperature + l])
                     .stress;
    }
    double flux = flux_of[l];
    if (stage.early_flux != nullptr) flux = sdirk2::kFirstWeight * stage.early_flux[l] + sdirk2::kDiagonal * flux;
    const double heat_of_step = flux * dt * (spreads ? heated_share(grid, shape + l) : 1.0);
    write_answer({{s, answer.slip, jump, flux, answer.regime}, heat_of_step, 0.0, outcome}, layout, l, trial, outputs);
    outputs.interface_temperature[l] = T[l];
    if (spreads)
      reshape_heat(problem, strain + l, strain_new + l, interface_slip / kSqrt3, trial + layout.heat_shape + l);
    if (inputs.wants_mean_stress)
      outputs.mean_shear_stress[l] = open ? 0.0
                                          : mean_stress(problem, soft_at(l), inputs, l, lane, dt, s_start[l], committed,
                                                        trial, friction, layer_slip > 0.0 || interface_slip > 0.0);
    trial[layout.stress_rate + l] = layer_slip > 0.0 ? (s - s_start[l]) / dt : 0.0;
  }
}

}  // namespace shearbus::physics
