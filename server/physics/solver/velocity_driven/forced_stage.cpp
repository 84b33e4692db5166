#include "server/physics/solver/velocity_driven/forced_stage.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "server/physics/solver/flow/root_search.hpp"
#include "server/physics/solver/scratch.hpp"

namespace shearbus::physics {
namespace {

// Mass per area of the layer  [kg/m2].
double mass_of_layer(const Problem& problem) {
  return problem.options.soft.density * problem.grid.vertex.back();
}

// Mass per area of the host's soft half zone behind the layer  [kg/m2].
double mass_behind_layer(const Problem& problem, double mass_soft) {
  return mass_soft - mass_of_layer(problem);
}

// Begins a stage of length dt: each face gives way as m dv/dt = (the host's force) - s. Returns the lanes whose host has
// too little mass.
std::uint32_t meet_bodies(const Problem& problem, double dt, const TileInputs& inputs, std::uint32_t lanes,
                          const WaveContacts& contacts, double* trial, WaveEnds& ends) {
  const TileLayout& layout = problem.layout;
  const std::size_t n = layout.num_stress_vertices - 1;
  const LeastMasses least = least_masses(problem, dt);
  std::uint32_t lost = 0;
  std::fill_n(ends.jump, kLanes, 0.0);
  std::fill_n(ends.give_near, kLanes, 1.0);
  std::fill_n(ends.give_far, kLanes, 1.0);
  for (const int l : lanes_of(lanes)) {
    const auto lane = static_cast<std::size_t>(l);
    const double mass = mass_behind_layer(problem, inputs.mass_soft[l]);
    if (!(inputs.mass_soft[l] > least.soft && inputs.mass_hard[l] > least.hard)) {
      lost |= 1u << l;
      continue;
    }
    // The stress before the stage and the host's force, each with its share of the trial stress.
    const auto meet = [&](std::size_t vertex, double of_body, double force) {
      const double follows = problem.options.soft.shear_modulus * dt / problem.grid.weight[vertex] * (dt / of_body);
      double& stress = trial[layout.shear_stress + vertex * kLanes + lane];
      stress = stress / (1.0 + follows) + force * (follows / (1.0 + follows));
      return 1.0 + follows;
    };
    ends.give_near[l] = meet(0, inputs.mass_hard[l], inputs.stress_hard[l]);
    ends.give_far[l] = meet(n, mass, inputs.stress_soft[l]);
    ends.jump[l] = trial[layout.layer_velocity + n * kLanes + lane] + contacts[l].drive;
  }
  return lost;
}

// Ends it: the bodies have the velocities that their impulses leave them, and all are relative to the hard one again.
void leave_bodies(const Problem& problem, double dt, const TileInputs& inputs, std::uint32_t lanes, double* trial) {
  const TileLayout& layout = problem.layout;
  const std::size_t n = layout.num_stress_vertices - 1;
  for (const int l : lanes_of(lanes)) {
    double* stress = trial + layout.shear_stress + static_cast<std::size_t>(l);
    double* velocity = trial + layout.layer_velocity + static_cast<std::size_t>(l);
    velocity[n * kLanes] +=
        (inputs.stress_soft[l] - stress[n * kLanes]) * (dt / mass_behind_layer(problem, inputs.mass_soft[l]));
    const double hard = (stress[0] - inputs.stress_hard[l]) * (dt / inputs.mass_hard[l]);
    for (std::size_t c = 0; c <= n; ++c) velocity[c * kLanes] -= hard;
  }
}

constexpr double kSlipKnown = 1e-12;  // waves give the slip to this part of the largest velocity
constexpr double kSameStress = 1e-6;  // relative
constexpr int kMostSlips = 40;        // that are tried downward from the most

// The slip of the contacts of a tile. Each slip velocity v has one stress that the contact carries,
// a = s_lim(T_ad + B0 beta_T a v, v), and with it one flux q = beta_T a v: at these the waves leave the interface a slip,
// and that must be v. It is more than v at rest, unless the interface can stick, and at most v at the slip that no stress
// leaves. In v, and not in a, all is smooth next to melting, where a falls as 1/v. What waves leave beyond v is flow of the
// vertex at z = 0: rounding, or all that a layer at its ceiling flows where the heat of v makes that the limit.
class SlidingWaves {
 public:
  SlidingWaves(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs, const WaveEnds& ends,
               const WaveContacts& contacts, const double* guess, double* trial, Found (&found)[kLanes])
      : problem_(problem),
        heat_(heat),
        inputs_(inputs),
        ends_(ends),
        contacts_(contacts),
        trial_(trial),
        found_(found),
        share_(problem.heat_partition) {
    std::copy_n(trial, problem.layout.doubles, start_);
    std::copy_n(guess != nullptr ? guess : trial + problem.layout.layer_velocity, velocities_, guess_);
  }

  // Returns the lanes that have no answer.
  std::uint32_t solve(std::uint32_t lanes) {
    for (const int l : lanes_of(lanes)) {
      lanes_[l].limit = contacts_[l].limit;
      lanes_[l].T_ad = start_[problem_.layout.temperature + static_cast<std::size_t>(l)];
    }
    search(rest(lanes) & ~lost_);
    for (const int l : lanes_of(lanes & ~lost_)) finish(l);
    return lost_;
  }

 private:
  struct Lane {
    StressLimit limit;
    double T_ad = 0.0, direction = 0.0;
    double most = -1.0;                 // slip that no stress leaves; negative: not known
    double v = 0.0, a = 0.0;            // the slip that is tried, and its stress
    double left = 0.0;                  // the slip that waves leave at that
    double at_rest = 0.0;               // the same for v = 0
    double known = 0.0;                 // accuracy of `left`
    double low = 0.0;                   // the largest slip that is tried and leaves more than itself
    double above = 0.0, missing = 0.0;  // the smallest one that leaves less, and by how much
    bool several = false;               // the interface can stick as well
    bool between = false;               // the search lies between `low` and `above`
    bool last = false;                  // the next evaluation is the answer
    RootSearch slips;
    double surplus() const { return v - left; }
    // At the slip v an interface that waves let slip; at rest any that slips by no more than rounding.
    bool closed() const { return std::abs(surplus()) <= known && (left > 0.0 || v == 0.0); }
  };

  std::ptrdiff_t row(std::size_t first, int l) const { return static_cast<std::ptrdiff_t>(first) + l; }

  // The stress that the contact carries at the slip v.
  double stress_at(const Lane& own, double v) const {
    if (!(v > 0.0)) return own.limit.at(own.T_ad, 0.0).stress;
    const double B0 = heat_.layer_response()[0];
    const FrictionHeating heating{own.T_ad, share_ * B0, v, 0.0};
    return below_melting(own.limit, heating, share_, B0,
                         slip_stress(own.limit, heating, std::numeric_limits<double>::infinity(), own.a));
  }

  // Solves the waves at the slips of `lanes` and their stresses, from the state before the stage.
  void evaluate(std::uint32_t lanes) {
    for (const int l : lanes_of(lanes & ~lost_)) {
      lanes_[l].a = stress_at(lanes_[l], lanes_[l].v);
      if (std::isnan(lanes_[l].a)) lost_ |= 1u << l;  // a law gave no number
    }
    solve_under_stress(lanes & ~lost_);
  }

  void solve_under_stress(std::uint32_t lanes) {
    for (const int l : lanes_of(lanes)) {
      Lane& own = lanes_[l];
      limit_[l] = own.a;
      copy_lane(start_, trial_, problem_.layout.doubles, l);
      add_flux_lane(heat_, problem_.heat_grid.num_vertices(), l, share_ * (own.a * own.v),
                    trial_ + problem_.layout.first_temperature());
    }
    lost_ |= solve_waves(problem_, heat_, inputs_, ends_, lanes, limit_, guess_, trial_, found_);
    for (const int l : lanes_of(lanes & ~lost_)) {
      Lane& own = lanes_[l];
      copy_lane(trial_ + problem_.layout.layer_velocity, guess_, velocities_, l);
      if (own.direction == 0.0) own.direction = std::signbit(trial_[row(problem_.layout.shear_stress, l)]) ? -1.0 : 1.0;
      own.left = std::max(0.0, own.direction * found_[l].interface_slip);
      own.known = kSlipKnown * fastest(l);
    }
  }

  // The largest velocity of the waves  [m/s].
  double fastest(int l) const {
    double most = std::abs(ends_.jump[l]);
    for (int c = 0; c < problem_.grid.num_cells(); ++c)
      most = std::max(most, std::abs(trial_[row(problem_.layout.layer_velocity, l) + std::ptrdiff_t{c} * kLanes]));
    return most + lanes_[l].left;
  }

  // Finds the slip that no stress leaves.
  void free(std::uint32_t lanes) {
    for (const int l : lanes_of(lanes)) lanes_[l].a = lanes_[l].v = 0.0;
    solve_under_stress(lanes & ~lost_);
    for (const int l : lanes_of(lanes & ~lost_)) lanes_[l].most = lanes_[l].left;
  }

  // Tries the contacts at rest. Returns the lanes that slip, or may: one that slips goes on while it can.
  std::uint32_t rest(std::uint32_t lanes) {
    for (const int l : lanes_of(lanes)) lanes_[l].v = 0.0;
    evaluate(lanes);
    std::uint32_t open = 0;
    for (const int l : lanes_of(lanes & ~lost_)) {
      Lane& own = lanes_[l];
      own.at_rest = own.left;
      own.several = own.closed();
      const bool weakens = own.limit.falls_with_slip() || own.limit.vanishes_at_melting();
      if (!own.several || (weakens && !contacts_[l].stuck && own.a > 0.0)) open |= 1u << l;
    }
    return open;
  }

  // Finds the slips. Under one stress, whatever the slip, no slip is more than that of the unheated layer; elsewhere the
  // search goes down from the slip that no stress leaves.
  void search(std::uint32_t lanes) {
    std::uint32_t unknown = 0;
    for (const int l : lanes_of(lanes)) {
      Lane& own = lanes_[l];
      const double hottest = own.T_ad + share_ * heat_.layer_response()[0] * (own.a * own.at_rest);
      own.above = !own.several && own.limit.is_constant_below(hottest, own.at_rest) ? own.at_rest : -1.0;
      if (own.above < 0.0 && own.most < 0.0) unknown |= 1u << l;
    }
    free(unknown);
    for (const int l : lanes_of(lanes)) {
      Lane& own = lanes_[l];
      own.v = own.above < 0.0 ? own.most : own.at_rest;
    }
    for (int k = 0; (lanes &= ~lost_) != 0; ++k) {
      evaluate(lanes);
      for (const int l : lanes_of(lanes & ~lost_))
        if (lanes_[l].last || lanes_[l].closed() || !go_on(lanes_[l], k)) lanes &= ~(1u << l);
    }
  }

  // Chooses the next slip. Returns false if the last one is the answer.
  static bool go_on(Lane& own, int tried) {
    const double surplus = own.surplus();
    if (!own.between) {
      if (surplus < 0.0 && tried == 0) return false;  // by rounding
      if (surplus < 0.0 || !own.several) {
        const bool more = surplus < 0.0;
        const double low = more ? own.v : 0.0, at_low = more ? surplus : -own.at_rest;
        const double above = more ? own.above : own.v, at_above = more ? own.missing : surplus;
        own.low = low;
        own.between = true;
        own.slips = RootSearch(low, at_low, above, at_above, above, own.left);
        own.v = own.slips.at();
        return true;
      }
      own.above = own.v;
      own.missing = surplus;
      own.v = own.left;
      if (own.v > kAtRest * own.most && tried < kMostSlips) return true;
      own.v = 0.0;  // it sticks
      own.last = true;
      return true;
    }
    if (surplus < 0.0) own.low = std::max(own.low, own.v);
    if (own.slips.update(surplus)) {
      own.v = own.low;
      own.last = true;
    } else {
      own.v = own.slips.at();
    }
    return true;
  }

  // The vertex at z = 0 takes what waves leave beyond the slip.
  void finish(int l) {
    Lane& own = lanes_[l];
    // Rounding may leave the stress of a layer at its ceiling a little below that of the contact.
    double& stress = trial_[row(problem_.layout.shear_stress, l)];
    if (own.v > 0.0 && std::abs(stress) != own.a) {
      if (!(std::abs(stress) >= own.a * (1.0 - kSameStress))) lost_ |= 1u << l;
      stress = found_[l].stress[0] = own.direction * own.a;
    }
    double& strain = trial_[row(problem_.layout.plastic_strain, l)];
    if (own.left == 0.0)
      strain = std::max(start_[row(problem_.layout.plastic_strain, l)],
                        strain - own.v * heat_.dt / (kSqrt3 * problem_.grid.weight[0]));
    strain += std::max(0.0, -own.surplus()) * heat_.dt / (kSqrt3 * problem_.grid.weight[0]);
    found_[l].flux = share_ * (own.a * own.v);
    found_[l].interface_slip = own.direction * own.v;
    found_[l].interface_slips = own.v > 0.0;
    found_[l].several = own.several && own.v > 0.0;
  }

  const Problem& problem_;
  const HeatOperator& heat_;
  const TileInputs& inputs_;
  const WaveEnds& ends_;
  const WaveContacts& contacts_;
  double* trial_;
  Found (&found_)[kLanes];
  const double share_;  // of the work of the slip that heats z = 0
  std::size_t velocities_ = problem_.layout.num_velocity_cells * kLanes;
  // The state before the stage, and the velocities of the last waves, from which the next ones are searched.
  double* start_ = scratch_tile(Scratch::kWaves, problem_.layout.doubles + velocities_);
  double* guess_ = start_ + problem_.layout.doubles;
  double limit_[kLanes] = {};
  Lane lanes_[kLanes];
  std::uint32_t lost_ = 0;
};

}  // namespace

LeastMasses least_masses(const Problem& problem, double dt) {
  constexpr double kMostSwing = 1e10;  // G0 dt^2/(weight m)
  const double rigid = problem.options.soft.shear_modulus * dt * (dt / kMostSwing);
  return {mass_of_layer(problem) + rigid / problem.grid.weight.back(), rigid / problem.grid.weight.front()};
}

void follow_host(const Problem& problem, const TileInputs& inputs, double* trial) {
  const TileLayout& layout = problem.layout;
  const std::size_t n = layout.num_velocity_cells - 1;
  for (const int l : lanes_of(inputs.active)) {
    double* velocity = trial + layout.layer_velocity + static_cast<std::size_t>(l);
    const double jump = inputs.velocity_jump[l];
    double ahead = mass_behind_layer(problem, inputs.mass_soft[l]) * (velocity[n * kLanes] - jump);
    for (std::size_t c = 0; c < n; ++c)
      ahead += problem.options.soft.density * problem.grid.width[c] * (velocity[c * kLanes] - jump);
    for (std::size_t c = 0; c <= n; ++c) velocity[c * kLanes] -= ahead / inputs.mass_soft[l];
  }
}

std::uint32_t solve_forced_stage(const Problem& problem, const HeatOperator& heat, const TileInputs& inputs,
                                 std::uint32_t lanes, const WaveContacts& contacts, double* trial,
                                 Found (&found)[kLanes], const double* guess) {
  WaveEnds ends;
  std::uint32_t lost = meet_bodies(problem, heat.dt, inputs, lanes, contacts, trial, ends);
  lost |= SlidingWaves(problem, heat, inputs, ends, contacts, guess, trial, found).solve(lanes & ~lost);
  leave_bodies(problem, heat.dt, inputs, lanes & ~lost, trial);
  for (const int l : lanes_of(lanes & ~lost)) found[l].mean_slip = found[l].interface_slip;
  return lost;
}

}  // namespace shearbus::physics
