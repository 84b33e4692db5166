#include "server/physics/solver/velocity_driven/wave_contacts.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "server/physics/material/elementary.hpp"
#include "server/physics/solver/flow/root_search.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/velocity_driven/waves.hpp"

namespace shearbus::physics {
namespace {

constexpr double kSlipKnown = 1e-12;  // waves give the slip to this part of the largest velocity
constexpr double kSameStress = 1e-6;  // relative
constexpr double kSameSlip = 1e-9;    // relative
constexpr double kUnsure = 100.0;     // times what waves know the slip to, a search may end apart
constexpr double kNothing = 1e-13;    // velocity that waves do not tell from none  [m/s]
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kMostSlips = 40;   // that are tried downward from the most
constexpr int kUsualSlips = 12;  // that a search between two slips needs, unless an interface creeps

// The slip of the contacts of a tile. Each slip velocity v has one stress that the contact carries, the zero of
//   a - s_lim(T0, v),   T0 = T_ad + B0 q,   q = beta_T a v, or beta_T a [V] where the jump is imposed:
// at these the waves leave the interface a slip, and that must be v. It is more than v at rest, unless the interface can
// stick, and at most v at the slip that no stress leaves. In v, and not in a, all is smooth next to melting, where a falls
// as 1/v. What waves leave beyond v is flow of the vertex at z = 0: rounding, or all that a layer at its ceiling flows where
// the heat of v, or what it adds to the strength of the contact, makes that the limit.
class SlidingWaves {
 public:
  SlidingWaves(const InertiaStage& stage, const WaveEnds& ends) : stage_(stage), ends_(ends) {
    std::copy_n(trial_, problem_.layout.doubles, start_);
    std::copy_n(stage.guess != nullptr ? stage.guess : trial_ + problem_.layout.layer_velocity, velocities_, guess_);
    waves_.guess = guess_;
  }

  // Returns the lanes that have no answer.
  std::uint32_t solve(std::uint32_t lanes) {
    for (const int l : lanes_of(lanes)) {
      lanes_[l].limit = contacts_[l].limit;
      lanes_[l].T_ad = start_[problem_.layout.temperature + static_cast<std::size_t>(l)];
      lanes_[l].jump = stage_.inputs.velocity_jump[l];
      lanes_[l].direction = std::copysign(1.0, lanes_[l].jump);
    }
    search(rest(lanes) & ~lost_);
    if (!forced_) stop(lanes & ~lost_);
    for (const int l : lanes_of(lanes & ~lost_)) finish(l);
    return lost_;
  }

 private:
  struct Lane {
    StressLimit limit;
    double T_ad = 0.0, jump = 0.0;
    double direction = 1.0;        // of the stress: until waves have been solved, that of the jump
    bool faced = false;            // waves have been solved
    double most = -1.0;            // slip that no stress leaves; negative: not known
    double v = 0.0, a = 0.0;       // the slip that is tried, and its stress
    double left = 0.0;             // the slip that waves leave at that
    double at_rest = 0.0;          // the same for v = 0
    double known = 0.0;            // accuracy of `left`
    double unused = 0.0;           // slip that the stress could stop beyond all slip, by waves or elastic shear
    double low = 0.0, more = 0.0;  // the largest slip that is tried and leaves more than itself, by how much
    double low_before = 0.0, more_before = 0.0;  // the same before that
    double above = 0.0, missing = 0.0;           // the smallest one that leaves less, and by how much
    bool several = false;                        // the interface can stick as well
    bool between = false;                        // the search lies between `low` and `above`
    bool creeps = false;                         // it goes on in 1 + ln(v/unit)
    bool tried_least = false;                    // the least slip has been tried, too
    bool last = false;                           // the next evaluation is the answer
    double unit = 0.0;
    RootSearch slips;
    double surplus() const { return v - left; }
    double slip_at() const { return creeps ? unit * exponential(slips.at() - 1.0) : slips.at(); }
    // At the slip v an interface that waves let slip; at rest any that slips by no more than rounding.
    bool closed() const { return std::abs(surplus()) <= known && (left > 0.0 || v == 0.0); }
  };

  std::ptrdiff_t row(std::size_t first, int l) const { return static_cast<std::ptrdiff_t>(first) + l; }

  // What the stress works on at the slip v, as far as that heats z = 0  [m/s].
  double heating_velocity(const Lane& own, double v) const {
    return forced_ ? v : std::max(0.0, own.direction * own.jump);
  }

  // The stress that the contact carries at the slip v.
  double stress_at(const Lane& own, double v) const {
    const FrictionHeating heating{own.T_ad, share_ * B0_, heating_velocity(own, v), 0.0};
    const StressLimit limit = own.limit.at_slip(v);
    return below_melting(limit, heating, share_, B0_, slip_stress(limit, heating, kInfinity, own.a));
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
      if (forced_)  // else the waves heat
        add_flux_lane(heat_, problem_.heat_grid.num_vertices(), l, share_ * (own.a * own.v),
                      trial_ + problem_.layout.first_temperature());
    }
    lost_ |= solve_waves(waves_, ends_, lanes, limit_);
    for (const int l : lanes_of(lanes & ~lost_)) {
      Lane& own = lanes_[l];
      copy_lane(trial_ + problem_.layout.layer_velocity, guess_, velocities_, l);
      if (!own.faced) own.direction = std::signbit(trial_[row(problem_.layout.shear_stress, l)]) ? -1.0 : 1.0;
      own.faced = true;
      own.left = std::max(0.0, own.direction * found_[l].interface_slip);
      own.known = kSlipKnown * fastest(l);
      const double left_over = own.a - own.direction * found_[l].stress[0];
      own.unused = own.left > 0.0 ? 0.0 : per_stress_ * std::max(0.0, left_over);
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
    evaluate(lanes);
    // A stress against an imposed jump does not heat. It carries more, so that the direction under less is the answer's.
    std::uint32_t turned = 0;
    for (const int l : lanes_of(lanes & ~lost_))
      if (!forced_ && lanes_[l].left > 0.0 && lanes_[l].direction * lanes_[l].jump < 0.0) turned |= 1u << l;
    evaluate(turned);
    std::uint32_t open = 0;
    for (const int l : lanes_of(lanes & ~lost_)) {
      Lane& own = lanes_[l];
      own.at_rest = own.left;
      if (!forced_ && !own.limit.depends_on_slip()) {  // one stress at any slip
        own.v = own.left;
        continue;
      }
      own.several = own.closed();
      const bool weakens = own.limit.falls_with_slip() || (forced_ && own.limit.vanishes_at_melting());
      if (!own.several || (weakens && !contacts_[l].stuck && own.a > 0.0)) open |= 1u << l;
    }
    return open;
  }

  // Finds the slips. Under a stress that no slip lowers none is more than that of the unheated layer; elsewhere the search
  // goes down from the slip that no stress leaves.
  void search(std::uint32_t lanes) {
    std::uint32_t unknown = 0;
    for (const int l : lanes_of(lanes)) {
      Lane& own = lanes_[l];
      const double hottest = own.T_ad + share_ * B0_ * (own.a * heating_velocity(own, own.at_rest));
      const bool lowers = forced_ ? !own.limit.is_constant_below(hottest, own.at_rest) : own.limit.falls_with_slip();
      own.above = own.several || lowers ? -1.0 : own.at_rest;
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
  bool go_on(Lane& own, int tried) const {
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
    if (surplus < 0.0) {
      own.low_before = std::exchange(own.low, own.v);
      own.more_before = std::exchange(own.more, -surplus);
    } else {
      own.above = own.v;
      own.missing = surplus + own.unused;
    }
    const bool of_search = own.v == own.slip_at();  // else it was the least slip
    if (of_search && own.slips.update(own.creeps ? surplus + own.unused : surplus)) {
      own.v = own.low;
      own.last = true;
      return true;
    }
    if (own.creeps) prefer_secant(own);
    own.v = own.slip_at();
    if (forced_ && tried >= kUsualSlips && !own.creeps) creep(own);
    return true;
  }

  // Under force an interface may creep many powers of ten below the slip that no stress leaves, where the stress
  // follows the logarithm of the slip: the search goes on in that logarithm and, where waves leave nothing, by the
  // stress that they leave unused. It first tries the least slip above rest, if none is known that leaves more than
  // itself.
  static void creep(Lane& own) {
    if (own.low > 0.0) {
      own.creeps = true;
      own.unit = own.low;
      own.slips = RootSearch(1.0, -own.more, 1.0 + logarithm(own.above / own.low), own.missing, own.at_rest, kInfinity);
      own.v = own.slip_at();
    } else if (!std::exchange(own.tried_least, true)) {
      own.v = std::min(own.v, std::max(own.known, own.limit.least_slip));
    }
  }

  // What is left falls by another slope from where waves leave nothing on, which is next to the answer. So the secant
  // of the two largest slips that leave something tells more of the answer than a search across.
  static void prefer_secant(Lane& own) {
    if (!(own.low_before > 0.0 && own.more_before > own.more)) return;
    const double low = 1.0 + logarithm(own.low / own.unit), step = logarithm(own.low / own.low_before);
    own.slips.prefer(low + step * (own.more / (own.more_before - own.more)));
  }

  // Lets interfaces stick that slip by a rounding of what the waves let slip under no stress.
  void stop(std::uint32_t lanes) {
    double slips[kLanes];
    std::uint32_t slow = 0;
    for (const int l : lanes_of(lanes)) {
      const double* stress = found_[l].stress;
      const double most = fastest(l) + per_stress_ * std::max(std::abs(stress[0]), std::abs(stress[1]));
      slips[l] = lanes_[l].v;
      if (slips[l] > 0.0 && slips[l] <= kAtRest * most) slow |= 1u << l;
    }
    free(slow);
    for (const int l : lanes_of(slow & ~lost_)) {
      Lane& own = lanes_[l];
      const bool slides = slips[l] > kAtRest * own.most;
      own.v = slides ? slips[l] : 0.0;
      own.a = slides ? stress_at(own, own.v) : kInfinity;
    }
    solve_under_stress(slow & ~lost_);
  }

  // The vertex at z = 0 takes what waves leave beyond the slip. Where the jump is imposed, what they leave by rounding is
  // slip: the vertex flows under its own strength alone.
  void finish(int l) {
    Lane& own = lanes_[l];
    if (!forced_ && std::abs(own.surplus()) <= kUnsure * own.known + kSameSlip * own.left + kNothing) own.v = own.left;
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
    // The slip of an interface at rest is rounding. Where work heats in place a vertex that is stronger than the contact
    // does not flow by it.
    const bool rounds =
        forced_ && problem_.options.taylor_quinney_factor && own.v == 0.0 && own.left <= kUnsure * own.known;
    if (!rounds) strain += std::max(0.0, -own.surplus()) * heat_.dt / (kSqrt3 * problem_.grid.weight[0]);
    if (forced_) found_[l].flux = share_ * (own.a * own.v);
    found_[l].interface_slip = own.direction * own.v;
    found_[l].interface_slips = own.v > 0.0;
    found_[l].several = own.several && own.v > 0.0;
  }

  const InertiaStage& stage_;
  const WaveEnds& ends_;
  const Problem& problem_ = stage_.problem;
  const HeatOperator& heat_ = stage_.heat;
  const WaveContacts& contacts_ = *stage_.contacts;
  double* trial_ = stage_.trial;
  Found (&found_)[kLanes] = stage_.found;
  InertiaStage waves_ = stage_;  // starts from the velocities of the last waves
  const bool forced_ = is_forced(problem_);
  const double share_ = heat_share(problem_);  // of the work at z = 0 that heats there
  const double B0_ = heat_.layer_response()[0];
  const double per_stress_ = velocity_per_stress(problem_.options.soft, problem_.grid, heat_.dt);
  std::size_t velocities_ = problem_.layout.num_velocity_cells * kLanes;
  // The state before the stage, and the velocities of the last waves, from which the next ones are searched.
  double* start_ = scratch_tile(Scratch::kWaves, problem_.layout.doubles + velocities_);
  double* guess_ = start_ + problem_.layout.doubles;
  double limit_[kLanes] = {};
  Lane lanes_[kLanes];
  std::uint32_t lost_ = 0;
};

}  // namespace

bool WaveContacts::needed(const Problem& problem) {
  const ModelOptions& o = problem.options;
  if (is_forced(problem)) return true;
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
    double fastest = std::abs(inputs.velocity_jump[l]);  // what moves the bodies  [m/s]
    if (is_forced(problem)) {
      own.drive = kSqrt3 * problem.options.grid.thickness * inputs.soft_plastic_strain_rate[l];
      fastest += std::abs(own.drive) + dt * (std::abs(inputs.stress_soft[l]) / inputs.mass_soft[l] +
                                             std::abs(inputs.stress_hard[l]) / inputs.mass_hard[l]);
    } else {
      fastest += std::abs(stress_before(problem.layout, inputs, committed, l)) *
                 velocity_per_stress(problem.options.soft, problem.grid, dt);
    }
    // A law with a state may carry nothing at rest: slower than this is rest.
    if (problem.layout.num_friction_states > 0) own.limit.least_slip = kAtRest * fastest;
  }
}

std::uint32_t solve_contacts(const InertiaStage& stage, const WaveEnds& ends, std::uint32_t lanes) {
  return SlidingWaves(stage, ends).solve(lanes);
}

}  // namespace shearbus::physics
