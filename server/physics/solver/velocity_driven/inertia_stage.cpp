#include "server/physics/solver/velocity_driven/inertia_stage.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "server/physics/interface/edge_zero.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/force_driven/interface_step.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/velocity_driven/forced_stage.hpp"
#include "server/physics/solver/velocity_driven/waves.hpp"
#include "server/physics/solver/velocity_driven/waves_wide.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

// Newton steps of the kernel in a search for the stress of the contact, which tries stresses far from the last answer.
constexpr int kStepsOfSearch = 25;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Share of the work of s(0) on the jump that waves turn into heat at z = 0. Where plastic work heats in place, and under
// force, the temperatures that waves are given hold all their heat (waves_heat.hpp, forced_stage.hpp).
double heat_share(const Problem& problem) {
  const bool jump_heats =
      !problem.options.taylor_quinney_factor && problem.options.strategy == Strategy::kVelocityDriven;
  return jump_heats ? problem.heat_partition : 0.0;
}

void gather(const double* rows, int count, double* values) {
  for (std::ptrdiff_t i = 0; i < count; ++i) values[i] = rows[i * kLanes];
}

void scatter(const double* values, int count, double* rows) {
  for (std::ptrdiff_t i = 0; i < count; ++i) rows[i * kLanes] = values[i];
}

// Backward Euler of one lane over the length of `heat`, from the state in `trial`, whose temperatures have been
// conducted already. Returns false if no answer was found.
bool search_lane(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs, const WaveEnds& ends,
                 double limit, const double* guess, double* trial, int l, Found& found) {
  const TileLayout& layout = problem.layout;
  const Grid& grid = problem.grid;
  const int n = grid.num_cells();
  const Material soft = at_pressure(problem.options.soft, inputs.pressure[l]);
  const WaveStep step{.soft = &soft,
                      .grid = &grid,
                      .response = heat.layer_response(),
                      .dt = heat.dt,
                      .pressure = inputs.pressure[l],
                      .jump = ends.jump[l],
                      .heat_share = heat_share(problem),
                      .coulomb = limit,
                      .give_near = ends.give_near[l],
                      .give_far = ends.give_far[l],
                      .forced = problem.options.strategy == Strategy::kForceDriven};
  WaveFields fields;
  gather(trial + layout.temperature + l, n + 1, fields.T_ad);
  gather(trial + layout.plastic_strain + l, n + 1, fields.strain);
  gather(trial + layout.shear_stress + l, n + 1, fields.stress);
  gather(trial + layout.layer_velocity + l, n, fields.velocity);

  if (guess != nullptr) gather(guess + l, n, fields.guess);
  fields.has_guess = guess != nullptr;
  const WaveAnswer answer = advance_waves(step, fields);
  if (inputs.effort != nullptr) {
    inputs.effort->newton_steps += answer.iterations;
    inputs.effort->guarded_steps += answer.guarded ? 1 : 0;
  }
  add_work(inputs, l, n * (1.0 + flow_work(soft.flow_law) * answer.iterations));
  if (!answer.found) return false;

  // A vertex flows in the direction of its stress. A stress that has fallen to 0 keeps its sign as +0 or -0.
  found = {.flux = answer.flux,
           .interface_slip = answer.interface_slip,
           .interface_slips = answer.interface_slip != 0.0,
           .stress = {fields.stress[0], fields.stress[n]}};
  found.slip_along[std::signbit(fields.stress[0])] = std::abs(answer.interface_slip) * step.dt;
  for (int i = 0; i <= n; ++i) {
    found.slip_along[std::signbit(fields.stress[i])] += kSqrt3 * grid.weight[i] * fields.strain_growth[i];
    fields.strain[i] += fields.strain_growth[i];
  }
  scatter(fields.strain, n + 1, trial + layout.plastic_strain + l);
  scatter(fields.stress, n + 1, trial + layout.shear_stress + l);
  scatter(fields.velocity, n, trial + layout.layer_velocity + l);
  add_flux_lane(heat, problem.heat_grid.num_vertices(), l, answer.flux, trial + layout.first_temperature());
  return true;
}

// Velocity-driven.
WaveEnds imposed_ends(const TileInputs& inputs) {
  WaveEnds ends;
  std::copy_n(inputs.velocity_jump, kLanes, ends.jump);
  std::fill_n(ends.give_near, kLanes, 1.0);
  std::fill_n(ends.give_far, kLanes, 1.0);
  return ends;
}

}  // namespace

// By Newton's method in all lanes at once, and by search_lane() where that has not found an answer.
std::uint32_t solve_waves(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs,
                          const WaveEnds& ends, std::uint32_t lanes, const double (&limit)[kLanes], const double* guess,
                          double* trial, Found (&found)[kLanes]) {
  if (lanes == 0) return 0;
  const TileLayout& layout = problem.layout;
  const int n = problem.grid.num_cells();
  const Material& any = problem.options.soft;
  if (!properties_of(any.flow_law).has_wave_return) {
    std::uint32_t unsolved = 0;
    for (const int l : lanes_of(lanes))
      if (!search_lane(problem, heat, inputs, ends, limit[l], guess, trial, l, found[l])) unsolved |= 1u << l;
    return unsolved;
  }
  WideWaveStep step{.soft = &any,
                    .grid = &problem.grid,
                    .response = heat.layer_response(),
                    .dt = heat.dt,
                    .heat_share = heat_share(problem),
                    .T_melt = {},
                    .bracket = {},
                    .jump = {},
                    .coulomb = {},
                    .give_near = {},
                    .give_far = {},
                    .T_ad = trial + layout.temperature,
                    .strain = trial + layout.plastic_strain,
                    .stress = trial + layout.shear_stress,
                    .velocity = trial + layout.layer_velocity,
                    .guess = guess,
                    .most_steps = guess != nullptr ? kStepsOfSearch : WideWaveStep{}.most_steps,
                    .tries_limit = guess != nullptr};
  std::copy_n(ends.give_near, kLanes, step.give_near);
  std::copy_n(ends.give_far, kLanes, step.give_far);
  for (const int l : lanes_of(lanes)) {
    const Material soft = at_pressure(any, inputs.pressure[l]);
    step.T_melt[l] = soft.melting_temperature;
    step.bracket[l] = 1.0 + soft.pressure_coefficient * inputs.pressure[l] +
                      soft.temperature_coefficient * SteinbergCochranGuinan::kReference;
    step.jump[l] = ends.jump[l];
    step.coulomb[l] = limit[l];
  }
  WideWaveAnswer answer;
  const std::uint32_t solved = advance_waves_wide(step, lanes, answer);
  std::uint32_t lost = 0;
  for (const int l : lanes_of(lanes)) {
    if (!contains(solved, l)) {
      if (!search_lane(problem, heat, inputs, ends, limit[l], guess, trial, l, found[l])) lost |= 1u << l;
      continue;
    }
    if (inputs.effort != nullptr) inputs.effort->newton_steps += static_cast<int>(answer.iterations[l]);
    add_work(inputs, l, n * (1.0 + answer.iterations[l]));
    const double* stress = trial + layout.shear_stress + l;
    found[l] = {.flux = answer.flux[l],
                .slip_along = {answer.slip_along[0][l], answer.slip_along[1][l]},
                .interface_slip = std::copysign(answer.interface_slip[l], stress[0]),
                .interface_slips = answer.interface_slip[l] != 0.0,
                .stress = {stress[0], stress[std::ptrdiff_t{n} * kLanes]}};
    found[l].slip_along[std::signbit(stress[0])] += answer.interface_slip[l] * heat.dt;
    add_flux_lane(heat, problem.heat_grid.num_vertices(), l, answer.flux[l], trial + layout.first_temperature());
  }
  return lost;
}

namespace {

// ---- Contact laws ----
//
// Under a given stress a at z = 0 the layer leaves its interface the slip v(a), which falls with a: the waves that come
// from the layer are a line. The stress is the one that the contact carries at this slip, a = s_lim(T0(a), v(a)).

// Heat flux per stress along `direction` at z = 0  [m/s].
double heat_per_stress(const Problem& problem, const TileInputs& inputs, int l, double direction) {
  return heat_share(problem) * std::max(0.0, direction * inputs.velocity_jump[l]);
}

double direction_of(double stress) {
  return std::signbit(stress) ? -1.0 : 1.0;
}

// A limit that depends on the temperature alone is a number before the waves are solved, one for each direction of the
// stress, since only a stress along the jump heats. The limit of a stress against the jump is the larger one, so that
// the direction found with the smaller is that of the answer.
std::uint32_t solve_under_temperature(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs,
                                      const WaveEnds& ends, std::uint32_t lanes, const WaveContacts& contacts,
                                      const double* guess, double* trial, Found (&found)[kLanes]) {
  const TileLayout& layout = problem.layout;
  double* start = scratch_tile(Scratch::kWaves, layout.doubles);
  std::copy_n(trial, layout.doubles, start);
  double limit[kLanes];
  for (const int l : lanes_of(lanes)) {
    const double rise = heat_per_stress(problem, inputs, l, inputs.velocity_jump[l] < 0.0 ? -1.0 : 1.0);
    const FrictionHeating heating{start[layout.temperature + l], heat.layer_response()[0], rise, 0.0};
    limit[l] = rise > 0.0 ? slip_stress(contacts[l].limit, heating, kInfinity, 0.0)
                          : contacts[l].limit.at(heating.T_ad).stress;
  }
  std::uint32_t lost = solve_waves(problem, heat, inputs, ends, lanes, limit, guess, trial, found);
  std::uint32_t against = 0;
  for (const int l : lanes_of(lanes & ~lost)) {
    if (!found[l].interface_slips || direction_of(trial[layout.shear_stress + l]) * inputs.velocity_jump[l] >= 0.0)
      continue;
    limit[l] = contacts[l].limit.at(start[layout.temperature + l]).stress;
    copy_lane(start, trial, layout.doubles, l);
    against |= 1u << l;
  }
  lost |= solve_waves(problem, heat, inputs, ends, against, limit, guess, trial, found);
  return lost;
}

// The search for the stress that the contacts of a tile carry where their limits depend on the slip. An interface that
// sticks sticks while it can; one that slips takes the answer with the most slip.
class ContactSearch {
 public:
  ContactSearch(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs, const WaveEnds& ends,
                const WaveContacts& contacts, const double* guess, double* trial, Found (&found)[kLanes])
      : problem_(problem),
        heat_(heat),
        inputs_(inputs),
        ends_(ends),
        contacts_(contacts),
        trial_(trial),
        found_(found) {
    std::copy_n(trial, problem.layout.doubles, start_);
    std::copy_n(guess != nullptr ? guess : trial + problem.layout.layer_velocity, velocities_, guess_);
    std::fill_n(limit_, kLanes, kInfinity);
  }

  // Returns the lanes that have no answer.
  std::uint32_t solve(std::uint32_t lanes) {
    std::uint32_t held = 0, slipping = 0;
    for (const int l : lanes_of(lanes)) {
      sought_[l].T_ad = start_[problem_.layout.temperature + static_cast<std::size_t>(l)];
      if (contacts_[l].stuck) held |= 1u << l;
    }
    solve_under_limit(held);
    for (const int l : lanes_of(held & ~lost_))
      if (!sticks(l)) slipping |= 1u << l;
    slipping = bracket(slipping | (lanes & ~held), held);
    search(slipping);
    answer(slipping);
    return lost_;
  }

 private:
  struct Sought {
    EdgeZero zero;
    SlipPoint free{};  // the start of the search: no stress, the most slip
    SlipPoint end{};   // its end: where the interface sticks, or can only carry less
    double direction = 1.0, T_ad = 0.0, T_per_stress = 0.0;
    double ceiling_slip = 0.0;  // slip velocity next to a layer that flows at its ceiling  [m/s]
    bool several = false;

    SlipPoint point(double a, double slip) const { return {a, T_ad + T_per_stress * a, std::max(0.0, slip)}; }
    SlipPoint point(double a, const Found& found) const { return point(a, direction * found.interface_slip); }
  };

  double& stress_of(int l) { return trial_[problem_.layout.shear_stress + static_cast<std::size_t>(l)]; }

  // Solves the waves under limit_, from the state before the step, starting from the velocities under the last stress.
  void solve_under_limit(std::uint32_t lanes) {
    for (const int l : lanes_of(lanes)) copy_lane(start_, trial_, problem_.layout.doubles, l);
    lost_ |= solve_waves(problem_, heat_, inputs_, ends_, lanes & ~lost_, limit_, guess_, trial_, found_);
    for (const int l : lanes_of(lanes & ~lost_))
      copy_lane(trial_ + problem_.layout.layer_velocity, guess_, velocities_, l);
  }

  // Takes the direction of the stress, and how it heats the interface, from the waves that were solved last.
  void face(int l) {
    Sought& own = sought_[l];
    own.direction = direction_of(stress_of(l));
    own.T_per_stress = heat_per_stress(problem_, inputs_, l, own.direction) * heat_.layer_response()[0];
  }

  // Of an interface that did not slip under the last limit: whether it sticks.
  bool sticks(int l) {
    Sought& own = sought_[l];
    const StressLimit& contact = contacts_[l].limit;
    face(l);
    own.end = own.point(std::abs(stress_of(l)), 0.0);
    own.several = contact.at(own.end.T, 0.0).stress >= own.end.a;
    return own.end.a == 0.0 || (own.several && (contacts_[l].stuck || !contact.falls_with_slip()));
  }

  // Finds the slip under no stress, with which the contact carries the most; and up to that limit, or to the stress at
  // which the interface sticks, if it is less, the end of the search. `held`: lanes whose end is known. Returns the lanes
  // that do not stick.
  std::uint32_t bracket(std::uint32_t lanes, std::uint32_t held) {
    for (const int l : lanes_of(lanes)) limit_[l] = 0.0;
    solve_under_limit(lanes);
    for (const int l : lanes_of(lanes & ~lost_)) {
      Sought& own = sought_[l];
      if (!contains(held, l)) face(l);
      own.free = own.point(0.0, found_[l]);
      if (!contains(held, l)) limit_[l] = contacts_[l].limit.at(own.T_ad, {own.free.v, 0.0}).stress;
    }
    const std::uint32_t open = lanes & ~held & ~lost_;
    solve_under_limit(open);
    for (const int l : lanes_of(open & ~lost_)) {
      if (found_[l].interface_slips) {
        face(l);
        sought_[l].end = sought_[l].point(limit_[l], found_[l]);
      } else if (sticks(l)) {
        lanes &= ~(1u << l);
      }
    }
    return lanes;
  }

  void search(std::uint32_t lanes) {
    for (const int l : lanes_of(lanes & ~lost_)) {
      Sought& own = sought_[l];
      own.zero = EdgeZero(contacts_[l].limit, own.free, own.end, own.end);
    }
    for (;;) {
      std::uint32_t unsolved = 0;
      for (const int l : lanes_of(lanes & ~lost_)) {
        if (sought_[l].zero.done()) continue;
        limit_[l] = sought_[l].zero.at();
        unsolved |= 1u << l;
      }
      if (unsolved == 0) return;
      solve_under_limit(unsolved);
      for (const int l : lanes_of(unsolved & ~lost_)) sought_[l].zero.update(sought_[l].point(limit_[l], found_[l]));
    }
  }

  // Solves once more where the last stress of the search is not the answer.
  void answer(std::uint32_t lanes) {
    std::uint32_t again = 0;
    for (const int l : lanes_of(lanes & ~lost_)) {
      Sought& own = sought_[l];
      const SlipPoint& zero = own.zero.answer();
      if (std::isnan(zero.a)) lost_ |= 1u << l;  // a law gave no number
      const double rest = kAtRest * own.free.v;
      const bool slides = own.zero.found() && zero.v > rest;
      own.several = own.several && slides;
      if (!slides) own.ceiling_slip = slip_under_ceiling(contacts_[l].limit, own.zero, own.end, rest);
      const double a = slides ? zero.a : kInfinity;
      if (limit_[l] != a) again |= 1u << l;
      limit_[l] = a;
    }
    solve_under_limit(again & ~lost_);
    for (const int l : lanes_of(lanes & ~lost_)) {
      found_[l].several = sought_[l].several;
      if (sought_[l].ceiling_slip > 0.0) share_ceiling(l);
    }
  }

  // Of the flow at z = 0 of a layer at its ceiling, the interface takes its own slip, which is no more than all of it.
  void share_ceiling(int l) {
    const std::size_t at = problem_.layout.plastic_strain + static_cast<std::size_t>(l);
    const double weight = kSqrt3 * problem_.grid.weight[0], flow = trial_[at] - start_[at];
    const double asked = sought_[l].ceiling_slip, taken = asked * heat_.dt / weight;
    trial_[at] = std::max(start_[at], trial_[at] - taken);
    const double v = taken < flow ? asked : flow * weight / heat_.dt;
    found_[l].interface_slip = sought_[l].direction * v;
    found_[l].interface_slips = true;
  }

  const Problem& problem_;
  const HeatOperator& heat_;
  const TileInputs& inputs_;
  const WaveEnds& ends_;
  const WaveContacts& contacts_;
  double* trial_;
  Found (&found_)[kLanes];
  std::size_t velocities_ = problem_.layout.num_velocity_cells * kLanes;
  // The state before the step, and the velocities under the last stress, from which the search under the next one starts.
  double* start_ = scratch_tile(Scratch::kWaves, problem_.layout.doubles + velocities_);
  double* guess_ = start_ + problem_.layout.doubles;
  double limit_[kLanes];
  Sought sought_[kLanes];
  std::uint32_t lost_ = 0;
};

}  // namespace

bool WaveContacts::needed(const Problem& problem) {
  const ModelOptions& o = problem.options;
  if (o.strategy == Strategy::kForceDriven) return true;
  const FrictionLaw law = problem.interface.friction_law;
  return limit_follows_slip(problem) || (has_friction(o) && properties_of(law).depends_on_temperature);
}

WaveContacts::WaveContacts(const Problem& problem, const TileInputs& inputs, const double* committed, double dt)
    : soft_at_(problem.options.soft, inputs) {
  const std::size_t sticking = problem.layout.sticking;
  for (const int l : lanes_of(inputs.active)) {
    Lane& own = lanes_[l];
    own.state = contact_before(problem, committed, l);
    own.limit = contact_limit(problem, soft_at_(l), inputs.pressure[l], dt, own.state, inputs.effort);
    own.stuck = sticking != TileLayout::kAbsent && committed[sticking + static_cast<std::size_t>(l)] != 0.0;
    if (problem.options.strategy != Strategy::kForceDriven) continue;
    own.drive = kSqrt3 * problem.options.grid.thickness * inputs.soft_plastic_strain_rate[l];
    // A law with a state may carry nothing at rest: slower than this is rest.
    if (problem.layout.num_friction_states > 0)
      own.limit.least_slip = kAtRest * (std::abs(inputs.velocity_jump[l]) + std::abs(own.drive) +
                                        dt * (std::abs(inputs.stress_soft[l]) / inputs.mass_soft[l] +
                                              std::abs(inputs.stress_hard[l]) / inputs.mass_hard[l]));
  }
}

std::uint32_t solve_stage(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs,
                          std::uint32_t lanes, const WaveContacts* contacts, double* trial, Found (&found)[kLanes],
                          const double* guess) {
  if (lanes == 0) return 0;
  if (problem.options.strategy == Strategy::kForceDriven)
    return solve_forced_stage(problem, heat, inputs, lanes, *contacts, trial, found, guess);
  const WaveEnds ends = imposed_ends(inputs);
  if (contacts == nullptr) {
    double limit[kLanes];
    for (const int l : lanes_of(lanes))
      limit[l] = interface_strength(problem.interface, problem.options.soft, inputs.pressure[l], nullptr).coulomb;
    return solve_waves(problem, heat, inputs, ends, lanes, limit, guess, trial, found);
  }
  return limit_follows_slip(problem)
             ? ContactSearch(problem, heat, inputs, ends, *contacts, guess, trial, found).solve(lanes)
             : solve_under_temperature(problem, heat, inputs, ends, lanes, *contacts, guess, trial, found);
}

}  // namespace shearbus::physics
