// The contact of one lane: its states, and the limit of its stress in a step. Every solver asks for it here.
#pragma once

#include <cmath>
#include <cstddef>

#include "server/physics/interface/bisection.hpp"
#include "server/physics/interface/edge_zero.hpp"
#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics {

// The states of the friction law and of the junctions of one lane.
struct ContactState {
  double junction_strain = 0.0;  // plastic strain ep_a
  FrictionStates friction{};
};

inline ContactState contact_before(const Problem& problem, const double* committed, int lane) {
  ContactState state;
  const TileLayout& layout = problem.layout;
  if (problem.options.junctions) state.junction_strain = committed[layout.junction_strain + lane];
  for (std::size_t i = 0; i < layout.num_friction_states; ++i)
    state.friction[i] = committed[layout.friction_state + i * kLanes + static_cast<std::size_t>(lane)];
  return state;
}

inline void store_contact(const Problem& problem, const ContactState& state, double* trial, int lane) {
  const TileLayout& layout = problem.layout;
  if (problem.options.junctions) trial[layout.junction_strain + lane] = state.junction_strain;
  for (std::size_t i = 0; i < layout.num_friction_states; ++i)
    trial[layout.friction_state + i * kLanes + static_cast<std::size_t>(lane)] = state.friction[i];
}

// Whether the limit of the interface depends on its slip.
inline bool limit_follows_slip(const Problem& problem) {
  return problem.options.junctions ||
         (has_friction(problem.options) && properties_of(problem.interface.friction_law).depends_on_slip());
}

// The limit in a step of length dt. `soft`: the material at the node's pressure.
inline StressLimit contact_limit(const Problem& problem, const Material& soft, double pressure, double dt,
                                 const ContactState& state, SearchEffort* effort) {
  StressLimit limit = interface_strength(problem.interface, soft, pressure, effort);
  limit.junctions =
      junctions_of(problem.options.junctions ? &*problem.options.junctions : nullptr, state.junction_strain, dt);
  limit.state = state.friction;
  limit.dt = dt;
  return limit;
}

// A layer at its ceiling flows by any amount under it. A contact that would slip away under less, but gains strength by
// slip, takes of that flow the slip at which it carries the ceiling. This is its velocity, after a search that has ended
// without slip at the ceiling `end`; 0: the contact gains too little. Slower than `rest`, an interface is at rest.
inline double slip_under_ceiling(const StressLimit& limit, const EdgeZero& search, const SlipPoint& end, double rest) {
  constexpr double kNextToCeiling = 1e-12;  // a slip under a stress as close as this to the ceiling is cut off by it
  const SlipPoint& below = search.below();
  if (!(below.v > rest && below.a >= end.a * (1.0 - kNextToCeiling))) return 0.0;
  const double v = bisected(0.0, below.v, [&](double slip) { return !(limit.at(end.T, slip).stress < end.a); }).hi;
  return v > rest ? v : 0.0;
}

// Goes on from the states before a step to those after it. `slip`: slip velocity of the interface. An open contact leaves
// its junctions as they are; what it does to a friction law, the law says. Returns false if a law gave no number.
[[nodiscard]] inline bool advance_contact(const StressLimit& limit, double slip, double T0, ContactState& state) {
  const double v = std::abs(slip);
  if (limit.pressure > 0.0 && limit.junctions.options != nullptr) state.junction_strain = limit.junctions.strain(v);
  state.friction = limit.states_after(T0, v);
  double sum = 0.0;
  for (const double value : state.friction) sum += value;
  return std::isfinite(sum);
}

}  // namespace shearbus::physics
