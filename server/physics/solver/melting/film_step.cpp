#include <algorithm>
#include <cmath>
#include <cstddef>

#include "server/physics/solver/force_driven/interface_step.hpp"
#include "server/physics/solver/melting/film_slip.hpp"
#include "server/physics/solver/melting/phase_change.hpp"
#include "server/physics/solver/solvers.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

constexpr double kSticks = 1e-13;  // a root within this share of the stress that sticks is that stress
constexpr int kNewtonSteps = 20;   // most steps in which phases and stress are sought together

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
  const FilmSlip slip(problem, soft, inputs.pressure[lane], trial_slip);
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
    const FilmSlip slip(problem, soft, inputs.pressure[lane], trial_slip);
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
