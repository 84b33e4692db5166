#include <algorithm>
#include <cmath>
#include <cstddef>

#include "server/physics/solver/flow/root_search.hpp"
#include "server/physics/solver/force_driven/interface_step.hpp"
#include "server/physics/solver/melting/melt_film.hpp"
#include "server/physics/solver/melting/phase_change.hpp"
#include "server/physics/solver/solvers.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

constexpr double kSticks = 1e-13;  // a root within this share of the stress that sticks is that stress
constexpr int kNewtonSteps = 20;   // most steps in which phases and stress are sought together

// Stress and slip of a closed interface that may melt: solid contact and film are in series.
//
// The interface of one step, in magnitudes along the trial direction. The film carries what shears it at the velocity
// of the end of the step, as an interface sticks at the end of a step: a film of no thickness then sticks.
struct FilmSlip {
  // `soft`: the material at the pressure.
  FilmSlip(const Problem& problem, const Material& soft, double pressure, const TrialSlip& trial_slip,
           SearchEffort* counted)
      : contact(problem.interface.friction_coefficient, problem.interface.yield_strength / kSqrt3, soft, pressure),
        trial(trial_slip),
        partition(problem.heat_partition),
        mean_free(0.5 * (trial_slip.jump_old + trial_slip.direction * trial_slip.jump_free)),
        jump_free(trial_slip.direction * trial_slip.jump_free),
        stick(trial_slip.stress_stick),
        hottest(mean_free > 0.0 ? std::min(stick, mean_free / trial_slip.per_stress) : stick),
        effort(counted) {}

  double film_stress(double compliance) const {
    return compliance > 0.0 ? jump_free / (trial.per_stress + compliance) : stick;
  }
  // The stress that contact and film carry.
  double carried(const PhaseChange::Response& at) const {
    if (effort != nullptr) ++effort->limit_values;
    return std::min({contact.stress(at.T0), film_stress(at.compliance), stick});
  }
  double slip(double a) const { return std::max(0.0, mean_free - 0.5 * trial.per_stress * a); }
  double flux(double a) const { return partition * (a * slip(a)); }

  // The root of a = carried(response to flux(a)) with the most slip. Up to the stress `hottest` the flux rises with the
  // stress, so that there is at most one root; beyond it there may be several, of which this is the smallest.
  // `respond(q)`: the response, which melts more and never cools where q is larger.
  template <class Respond>
  double root_most_slip(const Respond& respond) const {
    const auto beyond = [&](double a) { return a - carried(respond(flux(a))); };
    double a = root_below_hottest(respond);
    if (a < hottest || hottest >= stick) return a;
    // Beyond `hottest` the carried stress does not fall with the stress, so repeated insertion rises to the first root.
    constexpr int kMostInsertions = 100;
    double left = -beyond(a);
    for (int i = 0; i < kMostInsertions && left > kRounding * a; ++i) {
      a = std::min(a + left, stick);
      left = -beyond(a);
    }
    if (left <= kRounding * a || a >= stick) return a;
    const double last = beyond(stick);
    return last <= 0.0 ? stick : zero_between(a, -left, stick, last, stick, -1.0, beyond);
  }

  // The root in [0, hottest]; `hottest` if there is none. The carried stress falls with the stress there, so that the
  // root lies between the stress that is carried without heat and the one that is carried under the heat of that.
  template <class Respond>
  double root_below_hottest(const Respond& respond) const {
    const auto beyond = [&](double a) { return a - carried(respond(flux(a))); };
    double top = std::min(hottest, carried(respond(0.0)));
    const double least = top > 0.0 ? carried(respond(flux(top))) : 0.0;
    double above = top - least;
    if (above <= 0.0) return top;
    double bottom = std::max(least, kLeast * top);  // `top - above` would have lost the digits of a small stress
    double below = beyond(bottom);
    while (below < 0.0 && top > 4.0 * bottom) {  // they may be many powers of ten apart
      const double middle = std::sqrt(bottom) * std::sqrt(top);
      const double at = beyond(middle);
      (at < 0.0 ? bottom : top) = middle;
      (at < 0.0 ? below : above) = at;
    }
    return below < 0.0 ? zero_between(bottom, below, top, above, top, -1.0, beyond) : bottom;
  }

  SolidContact contact;
  TrialSlip trial;
  double partition;
  double mean_free;  // mean of the jumps before and after the step without friction  [m/s]
  double jump_free;  // jump after the step without friction                         [m/s]
  double stick;      // stress at which the jump after the step is 0  [Pa]
  double hottest;    // stress of most heat, at most `stick`          [Pa]
  SearchEffort* effort;

 private:
  static constexpr double kRounding = 1e-15;  // relative rounding of a stress
  static constexpr double kLeast = 1e-200;    // least root that is looked for, relative to an upper bound
};

// Stress and heat flux of a closed contact, in magnitudes.
struct Carried {
  double stress;  // [Pa]
  double flux;    // [W/m2]
  bool sticks;
  bool several;  // other answers satisfied the equations of the step too
};

// Whether the interface holds the stress at which it sticks, and has no film then. `respond(q)`: the response to a
// flux.
template <class Respond>
bool can_stick(const FilmSlip& slip, const Respond& respond) {
  const PhaseChange::Response at = respond(slip.flux(slip.stick));
  return at.compliance == 0.0 && at.T0 <= slip.contact.T_melt && slip.contact.stress(at.T0) >= slip.stick;
}

// The answer by the rule of MODEL.md, "Force-driven step": a stuck interface sticks if it can; one that slips takes the
// answer with the most slip.
template <class Respond>
Carried choose(const FilmSlip& slip, const Respond& respond, bool stuck) {
  const bool holds = can_stick(slip, respond);
  if (holds && stuck) return {slip.stick, slip.flux(slip.stick), true, false};
  const double root = slip.root_most_slip(respond);
  const bool sticks = holds && root >= slip.stick * (1.0 - kSticks);
  const double a = sticks ? slip.stick : root;
  return {a, slip.flux(a), sticks, holds && !sticks};
}

// The answer of a lane whose heat flux is sure to melt nothing more than is molten: T0 = T_ad + q B0.
bool slip_of_solid(const FilmSlip& slip, double T_ad, double B0, bool stuck, Carried& answer) {
  const auto respond = [&](double q) { return PhaseChange::Response{T_ad + q * B0, 0.0}; };
  answer = choose(slip, respond, stuck);
  return T_ad + answer.flux * B0 <= slip.contact.T_melt;
}

// The answer of a lane that melts or freezes. Phases and stress are found together, by Newton steps on the phases; if
// that does not end, or the root may not be the one with the most slip, the phases are solved anew for every trial flux.
Carried slip_of_melting(const FilmSlip& slip, PhaseChange& change, double coldest, bool stuck) {
  const auto respond = [&](double q) {
    change.settle(q);
    return change.at(q);
  };
  if (slip.contact.stress(coldest) < slip.stick) {  // else the interface may stick
    for (int step = 0; step < kNewtonSteps; ++step) {
      const double a = slip.root_below_hottest([&](double q) { return change.at(q); });
      const double q = slip.flux(a);
      if (change.revise(q)) continue;
      if (a < slip.hottest) return {a, q, false, false};
      break;
    }
  }
  const Carried answer = choose(slip, respond, stuck);
  change.settle(answer.flux);
  return answer;
}

Regime regime_of(const FilmSlip& slip, const Carried& answer, double T0, double thickness) {
  if (answer.sticks) return Regime::kStick;
  const bool solid = slip.contact.stress(T0) <= answer.stress * (1.0 + 1e-9);
  if (thickness > 0.0 && !solid) return Regime::kMelting;
  if (slip.contact.coulomb <= slip.contact.yield(T0)) return Regime::kCoulomb;
  return T0 >= kMeltingShare * slip.contact.T_melt ? Regime::kMelting : Regime::kTresca;
}

}  // namespace

std::optional<LaneResult> melting_step_at_rest(const Problem& problem, const StepOperators& operators,
                                               const TileInputs& inputs, const double* committed, const Material& soft,
                                               double T0, int lane) {
  const LaneStep before = InterfaceStep::before(problem.layout, inputs, committed, lane);
  const Forcing forcing = forcing_of(inputs, lane);
  const double dt = operators.dt();
  if (inputs.pressure[lane] <= 0.0) return LaneResult{open_step(forcing, dt, before.jump_new)};
  const TrialSlip trial_slip(forcing, dt, before.jump_new, before.stress);
  const FilmSlip slip(problem, soft, inputs.pressure[lane], trial_slip, inputs.effort);
  Carried answer{};
  const bool solid = slip_of_solid(slip, T0, *operators.heat().layer_response(), before.sticks, answer);
  if (!solid || !answer.sticks || answer.flux != 0.0) return std::nullopt;
  const double stress = trial_slip.direction * answer.stress;
  return LaneResult{
      {stress, trial_slip.direction * slip.slip(answer.stress), 0.0, 0.0, Regime::kStick, true, true, answer.several},
      0.0,
      0.0,
      answer.several ? kMultipleRoots : std::uint8_t{0}};
}

void advance_force_driven_melting(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                  const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const HeatOperator& heat = operators.heat();
  const int n = problem.heat_rows;
  const double dt = heat.dt, B0 = *heat.layer_response();
  const double* T_old = committed + layout.first_temperature();
  double* T = trial + layout.first_temperature();
  const double* T0 = trial + layout.temperature;

  // 1. Conduction without friction of all lanes, as if nothing melted or froze: DLP (28-35). Which lanes hold liquid,
  // or solid above a melting temperature that has fallen, and the coldest temperature of each.
  conduct(heat, n, T_old, T);
  std::copy_n(committed + layout.liquid_fraction, layout.num_vertices * kLanes, trial + layout.liquid_fraction);
  double least[kLanes], most[kLanes], coldest[kLanes], soft_coldest[kLanes], hottest[kLanes];
  const auto vertices = static_cast<std::ptrdiff_t>(layout.num_vertices);
  range_of_rows(vertices, committed + layout.liquid_fraction, least, most);
  range_of_rows(vertices, committed + layout.temperature, soft_coldest, hottest);
  std::copy_n(soft_coldest, kLanes, coldest);
  if (layout.num_hard_vertices > 0) {
    double unused[kLanes];
    range_of_rows(static_cast<std::ptrdiff_t>(layout.num_hard_vertices), T_old, coldest, unused);
    for (int l = 0; l < kLanes; ++l) coldest[l] = std::min(coldest[l], soft_coldest[l]);
  }

  // 2. Stress, slip and heat, DLP (61), (65), lane by lane.
  thread_local PhaseChange change;
  double flux[kLanes] = {};
  const LaneMaterials soft_at(problem.options.soft, inputs);
  for (const int lane : lanes_of(inputs.active)) {
    const Material& soft = soft_at(lane);
    const LaneStep before = InterfaceStep::before(layout, inputs, committed, lane);
    const Forcing forcing = forcing_of(inputs, lane);
    const bool open = inputs.pressure[lane] <= 0.0;
    const bool changes = most[lane] > 0.0 || hottest[lane] > soft.melting_temperature;
    const TrialSlip trial_slip(forcing, dt, before.jump_new, before.stress);
    const FilmSlip slip(problem, soft, inputs.pressure[lane], trial_slip, inputs.effort);
    Carried answer{};
    bool molten = changes;
    if (!open && !changes) molten = !slip_of_solid(slip, T0[lane], B0, before.sticks, answer);
    add_work(inputs, lane, n + kSearchWork);
    if (molten) {
      change.begin(problem, heat, soft, committed, lane);
      if (open)
        change.settle(0.0);
      else
        answer = slip_of_melting(slip, change, coldest[lane], before.sticks);
      change.finish(answer.flux, trial);
      add_work(inputs, lane, change.work());
      if (inputs.effort != nullptr) inputs.effort->layer_sums += change.solves();
    } else {
      flux[lane] = answer.flux;
    }

    // 3. Answer.
    const double thickness = molten ? film_thickness(problem, trial, lane) : 0.0;
    const double T0_new = T0[lane] + flux[lane] * B0;
    LaneStep step = open_step(forcing, dt, before.jump_new);
    if (!open) {
      step.stress = trial_slip.direction * answer.stress;
      step.slip = trial_slip.direction * slip.slip(answer.stress);
      step.jump_new = answer.sticks || answer.stress >= slip.stick ? 0.0 : trial_slip.jump_new(answer.stress);
      step.regime = regime_of(slip, answer, T0_new, thickness);
    }
    write_answer({step, answer.flux * dt, flux[lane], answer.several ? kMultipleRoots : std::uint8_t{0}}, layout, lane,
                 trial, outputs);
    outputs.film_thickness[lane] = thickness;
  }

  // 4. The friction heat of the lanes that stay solid: T = T_ad + q B.
  add_flux(heat, n, flux, T);
  if (problem.heat_grid.hard_end_is_held) std::copy_n(T_old, kLanes, T);
  if (problem.heat_grid.soft_end_is_held)
    std::copy_n(T_old + std::ptrdiff_t{n - 1} * kLanes, kLanes, T + std::ptrdiff_t{n - 1} * kLanes);
  for (const int lane : lanes_of(inputs.active)) outputs.interface_temperature[lane] = T0[lane];
}

}  // namespace shearbus::physics
