#include "server/physics/solver/velocity_driven/waves_heat.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "server/physics/interface/bisection.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/flow/root_search.hpp"
#include "server/physics/solver/scratch.hpp"

namespace shearbus::physics {
namespace {

constexpr double kVelocity = 1e-12;        // the velocities of the waves are known to this part of the largest
constexpr double kForcedVelocity = 1e-14;  // the same under force, where what is known of them is closed, close_leap()
constexpr double kClosed = 1e-12;          // largest difference of work and heat, relative to the heat
constexpr double kDigits = 1e-9;           // the same where the last digit of a temperature decides, next to melting
constexpr double kSameFlow = 1e-5;         // relative difference up to which the mean of two flows has the mean stress
constexpr double kSameSlip = 1e-3;         // relative difference of slips of one contact, for which the same holds
constexpr double kLeastRoom = 1e-12;       // a vertex that is nearer to melting takes no heat, relative to T_melt
constexpr double kSmallStep = 0.5;      // a larger lack of heat, relative to it, lets the vertices change that take it,
constexpr int kMostCloseAmounts = 6;    // so does one that is left after so many amounts
constexpr double kFartherAmount = 4.0;  // factor by which the amount then grows
constexpr int kMostAmounts = 60;        // of the search for enough heat

// The heat of a step goes where its work W1 is done at the temperatures that the heat of the step before would bring:
//   Q[i] = amount W1[i] (T_melt - T[i])/(T_melt - T_ad[i]),
// which is linear in T, ceases at melting and rises with the amount, for any step and conduction. The amount is that at
// which the layer with the temperatures of this heat does as much work: without heat it does more, and a layer that is
// molten wherever it works does none.
class HeatedWaves {
 public:
  HeatedWaves(const StepOperators& operators, const InertiaStage& stage, const double* committed)
      : operators_(operators), stage_(stage), T_old_(committed + problem_.layout.first_temperature()) {
    std::copy_n(trial_, problem_.layout.doubles, start_);
  }

  std::uint32_t solve(std::uint32_t lanes) {
    evaluate(lanes, nullptr);
    std::uint32_t working = 0;
    for (const int l : lanes_of(lanes & ~lost_)) {
      found_[l].flux = 0.0;
      if (!(lanes_[l].work > 0.0)) continue;
      heat_as_before(l);
      working |= 1u << l;
    }
    evaluate(working, guess_);
    for (const int l : lanes_of(working & ~lost_))
      if (lanes_[l].work > 0.0) copy_lane(done_, power_, row(), l);
    search(bracket(working & ~lost_));
    for (const int l : lanes_of(working & ~lost_)) {
      if (lanes_[l].solved)
        heat_up(l);
      else
        lost_ |= 1u << l;
    }
    return lost_;
  }

 private:
  enum class Solved { kRise, kLeft };
  struct Lane {
    double amount = 0.0, work = 0.0, heat = 0.0;  // work and heat: powers of the last evaluation  [W/m2]
    double work_before = 0.0;                     // work without heat  [W/m2]
    double low = 0.0, work_at_low = 0.0;          // the largest amount known that is too small, its lack of heat
    double high = 0.0;                            // the smallest amount known that is enough, with an answer
    bool solved = true;                           // the last evaluation has an answer
    bool has_too_little = false;                  // there are waves of an amount that is too small
    RootSearch amounts;
    double unknown = 0.0;  // what the last digits of the velocities do  [W/m2]
    double T_melt = 0.0;
    bool closed(double share = kClosed) const { return std::abs(work - heat) <= share * heat + unknown; }
  };

  // Lets the work without heat, `done_`, heat where that of the step before did.
  void heat_as_before(int l) {
    const double* shape = start_ + problem_.layout.heat_shape;
    Lane& own = lanes_[l];
    own.work_before = own.work;
    own.amount = 1.0;
    own.T_melt = at_pressure(problem_.options.soft, inputs_.pressure[l]).melting_temperature;
    if (forced_) measure_room(l);
    double sum = 0.0;
    for (std::size_t i = static_cast<std::size_t>(l); i < row(); i += kLanes) sum += shape[i];
    for (std::size_t i = static_cast<std::size_t>(l); i < row(); i += kLanes)
      power_[i] = sum > 0.0 ? own.work * (shape[i] / sum) : done_[i];
  }

  std::size_t row() const { return problem_.layout.num_strain_vertices * kLanes; }
  std::size_t velocities() const { return problem_.layout.num_velocity_cells * kLanes; }
  std::ptrdiff_t vertices() const { return static_cast<std::ptrdiff_t>(problem_.layout.num_strain_vertices); }

  // The waves at the temperatures of the amounts, searched from these velocities; null: those before the step. Returns the
  // lanes without an answer.
  std::uint32_t solve_at(std::uint32_t lanes, const double* guess) {
    for (const int l : lanes_of(lanes)) {
      copy_lane(guess != nullptr ? guess : start_ + problem_.layout.layer_velocity, used_, velocities(), l);
      copy_lane(start_, trial_, problem_.layout.doubles, l);
      lanes_[l].heat = lanes_[l].amount <= 0.0 ? 0.0 : forced_ ? warm<true>(l) : warm<false>(l);
    }
    InertiaStage from = stage_;
    from.guess = guess;
    return solve_stage(from, lanes);
  }

  // Finds work and heat of `lanes` at the temperatures of their amounts.
  void evaluate(std::uint32_t lanes, const double* guess) {
    std::uint32_t lost = solve_at(lanes & ~lost_, guess);
    if (lost != 0 && guess != nullptr) lost = solve_at(lost, nullptr);
    // Waves next to melting that are not solved do no work: less heat is tried, and the last heat must be solved.
    for (const int l : lanes_of(lanes)) lanes_[l].solved = !contains(lost, l);
    for (const int l : lanes_of(lost)) {
      lanes_[l].work = 0.0;
      if (!(lanes_[l].amount > 0.0)) lost_ |= 1u << l;
    }
    lanes &= ~lost;
    for (const int l : lanes_of(lanes & ~lost_)) {
      lanes_[l].work = work(l);
      copy_lane(trial_ + problem_.layout.layer_velocity, guess_, velocities(), l);
    }
  }

  // Notes that the amount is enough. The waves next to melting may depend on the velocities from which they are searched,
  // so these are kept for the last evaluation.
  void note_enough(int l) {
    Lane& own = lanes_[l];
    if (!own.solved || !(own.high == 0.0 || own.amount < own.high)) return;
    own.high = own.amount;
    copy_lane(used_, used_at_high_, velocities(), l);
  }

  // Under force: finds room = T_melt - T_ad with all its digits, by the step from T_melt - T_old. `cold_`: the latter, to
  // which the vertices behind the layer and in the hard body, whose rows are eliminated, add theirs.
  void measure_room(int l) {
    const HeatOperator& heat = operators_.heat();
    const auto cold = [&](std::ptrdiff_t i) { return lanes_[l].T_melt - T_old_[i * kLanes + l]; };
    const auto eliminated = [&](std::ptrdiff_t i, double outer) {
      const auto at = static_cast<std::size_t>(i);
      return cold(i) * heat.inverse_pivot[at] + heat.inward[at] * outer;
    };
    const std::ptrdiff_t near = heat.interface, far = near + vertices() - 1;
    double behind = 0.0, hard = 0.0;
    for (std::ptrdiff_t i = problem_.heat_rows - 1; i > far; --i) behind = eliminated(i, behind);
    for (std::ptrdiff_t i = 0; i < near; ++i) hard = eliminated(i, hard);
    double* rows = cold_ + l * vertices();
    for (std::ptrdiff_t i = near; i <= far; ++i) rows[i - near] = cold(i);
    const auto first = static_cast<std::size_t>(near), last = static_cast<std::size_t>(far);
    rows[far - near] += heat.inward[last] / heat.inverse_pivot[last] * behind;
    rows[0] += heat.inward_hard / heat.inverse_pivot[first] * hard;
    const double none[kMaxInertiaCells + 1] = {};
    sweep<Solved::kLeft>(none, none, rows, room_ + l);
  }

  // Raises the temperatures of the layer in `trial` by the heat of the amount, and returns the sum of this heat. A vertex
  // that its neighbours melt takes none.
  template <bool kForced>
  double warm(int l) {
    const double T_melt = lanes_[l].T_melt;
    const double* T_ad = start_ + problem_.layout.temperature + l;
    double* rise = rise_ + l;
    double room[kMaxInertiaCells + 1], flux[kMaxInertiaCells + 1];
    for (std::ptrdiff_t i = 0; i < vertices(); ++i) {
      room[i] = kForced ? room_[i * kLanes + l] : T_melt - T_ad[i * kLanes];
      flux[i] = room[i] > kLeastRoom * T_melt ? lanes_[l].amount * power_[i * kLanes + l] : 0.0;
    }
    for (bool molten = true; molten;) {
      sweep<Solved::kRise>(flux, room, nullptr, rise);
      if constexpr (kForced) sweep<Solved::kLeft>(flux, room, cold_ + l * vertices(), left_ + l);
      molten = false;
      for (std::ptrdiff_t i = 0; i < vertices(); ++i) {
        const bool melts = kForced ? left_[i * kLanes + l] < 0.0 : rise[i * kLanes] > room[i] * (1.0 + kLeastRoom);
        if (!(flux[i] > 0.0 && melts)) continue;
        flux[i] = 0.0;
        molten = true;
      }
    }
    double sum = 0.0;
    for (std::ptrdiff_t i = 0; i < vertices(); ++i) {
      double& T = trial_[problem_.layout.temperature + static_cast<std::size_t>(i * kLanes + l)];
      if constexpr (kForced) {
        T = warmed(l, i, 1.0);
        if (flux[i] > 0.0) sum += flux[i] * (left_[i * kLanes + l] / room[i]);
      } else {
        T += rise[i * kLanes];
        if (flux[i] > 0.0) sum += flux[i] * std::max(0.0, 1.0 - rise[i * kLanes] / room[i]);
      }
    }
    return sum;
  }

  // Under force: the temperature of a vertex after a share of the rise. Nearer to melting than to T_ad it is by what is
  // left to melting.
  double warmed(int l, std::ptrdiff_t vertex, double share) const {
    const std::ptrdiff_t at = vertex * kLanes + l;
    if (share == 1.0 && left_[at] > 0.0 && left_[at] < rise_[at])
      return std::min(lanes_[l].T_melt - left_[at], std::nextafter(lanes_[l].T_melt, 0.0));
    return start_[problem_.layout.temperature + static_cast<std::size_t>(at)] + share * rise_[at];
  }

  // The rise of the temperatures of the layer where the vertices take flux (1 - rise/room), or what that leaves to melting:
  // then `right` is what the temperatures before the step leave, else it is not used. The matrix is that of the step with a
  // term more in the diagonal of each heated vertex; `excess` is what they add to its pivots.
  template <Solved kSolved>
  void sweep(const double* flux, const double* room, const double* right, double* result) const {
    const HeatOperator& heat = operators_.heat();
    const SpreadHeat& spread = operators_.spread();
    double inner[kMaxInertiaCells + 1];
    double excess = 0.0, pivot = 1.0;
    const std::ptrdiff_t last = vertices() - 1;
    for (std::ptrdiff_t i = last; i >= 0; --i) {
      const auto at = static_cast<std::size_t>(heat.interface + i);
      const double plain = 1.0 / heat.inverse_pivot[at], outer = i < last ? heat.inward[at] * plain : 0.0;
      const double source = spread.gain[static_cast<std::size_t>(i)] * flux[i];
      excess = i < last ? outer * heat.outward[at + 1] * (excess / pivot) : 0.0;
      if (source > 0.0) excess += source / room[i];
      pivot = plain + excess;
      const double own = kSolved == Solved::kRise ? source : right[i];
      result[i * kLanes] = (own + (i < last ? outer * result[(i + 1) * kLanes] : 0.0)) / pivot;
      inner[i] = i > 0 ? heat.outward[at] * plain / pivot : 0.0;
    }
    for (std::ptrdiff_t i = 1; i <= last; ++i) result[i * kLanes] += inner[i] * result[(i - 1) * kLanes];
  }

  // The work of each vertex that becomes heat, and its sum  [W/m2].
  double work(int l) {
    const std::size_t strain = problem_.layout.plastic_strain + static_cast<std::size_t>(l);
    const std::size_t stress = problem_.layout.shear_stress + static_cast<std::size_t>(l);
    const double factor = *problem_.options.taylor_quinney_factor * kSqrt3 / operators_.dt();
    double sum = 0.0, largest = 0.0;
    for (std::size_t i = 0; i < problem_.layout.num_strain_vertices; ++i) {
      const std::size_t at = i * kLanes;
      largest = std::max(largest, std::abs(trial_[stress + at]));
      const double flow = problem_.grid.weight[i] * std::max(0.0, trial_[strain + at] - start_[strain + at]);
      double done = factor * std::abs(trial_[stress + at]) * flow;
      if (i == 0) done += std::abs(trial_[stress] * found_[l].interface_slip);
      sum += done_[at + static_cast<std::size_t>(l)] = done;
    }
    double fastest = std::abs(inputs_.velocity_jump[l]);
    for (std::size_t c = 0; c < problem_.layout.num_velocity_cells; ++c)
      fastest = std::max(fastest, std::abs(trial_[problem_.layout.layer_velocity + c * kLanes + l]));
    lanes_[l].unknown = (forced_ ? kForcedVelocity : kVelocity) * largest * fastest;
    return sum;
  }

  // Finds an amount with enough heat. Where much is missing, vertices work that did not without heat: they are heated,
  // too. Returns the lanes that have an amount on either side of theirs.
  std::uint32_t bracket(std::uint32_t lanes) {
    std::uint32_t open = lanes, bracketed = 0;
    for (const int l : lanes_of(lanes)) lanes_[l].work_at_low = lanes_[l].work_before;
    for (int round = 0; open != 0 && round < kMostAmounts; ++round) {
      evaluate(open, guess_);
      open &= ~lost_;
      for (const int l : lanes_of(open)) {
        Lane& own = lanes_[l];
        const double missing = own.work - own.heat;
        if (own.closed() || missing <= 0.0) {
          open &= ~(1u << l);
          if (own.closed()) continue;
          note_enough(l);
          const double share = own.work_at_low / (own.work_at_low - missing);
          own.amounts = RootSearch(own.low, -own.work_at_low, own.amount, -missing, own.work_before,
                                   own.low + share * (own.amount - own.low));
          bracketed |= 1u << l;
        } else if (round < kMostCloseAmounts && missing <= kSmallStep * own.heat) {
          own.low = own.amount;
          own.work_at_low = missing;
          own.amount *= 1.0 + static_cast<double>(2 << round) * (missing / own.heat);
        } else {
          for (std::size_t i = static_cast<std::size_t>(l); i < row(); i += kLanes)
            power_[i] = std::max(power_[i], done_[i]);
          own.low = 0.0;
          own.work_at_low = own.work_before;
          own.amount *= kFartherAmount;
        }
      }
    }
    lost_ |= open;
    return bracketed;
  }

  // Finds the amount. Where work leaps from more to less than the heat, as a contact changes from stick to slip or the
  // last digit of a temperature next to melting changes, the answer is that of the hotter side, one of several.
  void search(std::uint32_t lanes) {
    while (lanes != 0) {
      for (const int l : lanes_of(lanes)) lanes_[l].amount = lanes_[l].amounts.at();
      evaluate(lanes, guess_);
      lanes &= ~lost_;
      std::uint32_t leaps = 0;
      for (const int l : lanes_of(lanes)) {
        Lane& own = lanes_[l];
        const double surplus = own.heat - own.work;
        if (surplus >= 0.0) note_enough(l);
        if (forced_ && surplus < 0.0) note_too_little(l);
        if (own.closed()) {
          lanes &= ~(1u << l);
        } else if (own.amounts.update(surplus)) {
          lanes &= ~(1u << l);
          if (own.high > 0.0) {
            leaps |= 1u << l;
            own.amount = own.high;
          } else {
            lost_ |= 1u << l;
          }
        }
      }
      evaluate(leaps, used_at_high_);
      for (const int l : lanes_of(forced_ ? leaps & ~lost_ : 0u)) close_leap(l);
    }
  }

  // Keeps the waves of the largest amount that is too small.
  void note_too_little(int l) {
    lanes_[l].has_too_little = true;
    found_at_low_[l] = found_[l];
    copy_lane(trial_, at_low_, problem_.layout.doubles, l);
  }

  // Closes a leap that the last digits of temperatures and velocities make; of light bodies they may be any part of the
  // work. The answer is the mean of the waves on both sides of the leap whose work is the heat: all balances but the yield
  // stress are linear in the waves. Where the contact changes, the leap stays.
  void close_leap(int l) {
    Lane& own = lanes_[l];
    const Found low = found_at_low_[l], high = found_[l];
    const bool same_contact =
        low.interface_slips == high.interface_slips &&
        std::abs(low.interface_slip - high.interface_slip) <= kSameSlip * std::abs(low.interface_slip);
    if (own.closed(kDigits) || !own.solved || !own.has_too_little || !same_contact) return;
    copy_lane(trial_, at_high_, problem_.layout.doubles, l);
    const TileLayout& layout = problem_.layout;
    const auto lane = static_cast<std::size_t>(l);
    const Material soft = at_pressure(problem_.options.soft, inputs_.pressure[l]);
    const auto between = [&](double share) {
      const auto mean = [&](double one, double two) { return two + share * (one - two); };
      const auto take_mean = [&](std::size_t at) { trial_[at] = mean(at_low_[at], at_high_[at]); };
      for (std::size_t i = 0; i < layout.num_strain_vertices * kLanes; i += kLanes) {
        const std::size_t strain = layout.plastic_strain + i + lane, stress = layout.shear_stress + i + lane;
        take_mean(strain);
        take_mean(stress);
        const bool rubs = i == 0 && high.interface_slips,
                   along = std::signbit(at_low_[stress]) == std::signbit(at_high_[stress]);
        const double low_flow = at_low_[strain] - start_[strain], high_flow = at_high_[strain] - start_[strain];
        if (rubs || (along && std::abs(low_flow - high_flow) <= kSameFlow * high_flow) ||
            trial_[strain] == start_[strain])
          continue;
        const double rate = (trial_[strain] - start_[strain]) / operators_.dt();
        const double yield =
            flow_stress(soft, trial_[strain], inputs_.pressure[l], trial_[layout.temperature + i + lane], rate);
        trial_[stress] = std::copysign(yield / kSqrt3, high_flow > 0.0 ? at_high_[stress] : at_low_[stress]);
      }
      for (std::size_t c = 0; c < layout.num_velocity_cells * kLanes; c += kLanes)
        take_mean(layout.layer_velocity + c + lane);
      Found& found = found_[l];
      for (int k = 0; k < 2; ++k) {
        found.slip_along[k] = mean(low.slip_along[k], high.slip_along[k]);
        found.stress[k] = mean(low.stress[k], high.stress[k]);
      }
      found.stress[0] = trial_[layout.shear_stress + lane];
      found.interface_slip = mean(low.interface_slip, high.interface_slip);
      found.mean_slip = mean(low.mean_slip, high.mean_slip);
      own.work = work(l);
      return own.work > own.heat;
    };
    between(bisected(0.0, 1.0, between).lo);
  }

  // The temperatures at the end of the step, and where its work has heated. They are those of evaluate() but for rounding,
  // which melts no vertex, and leaps, which only cool.
  void heat_up(int l) {
    const Lane& own = lanes_[l];
    const bool leaps = !own.closed(kDigits);
    const std::size_t first = problem_.layout.first_temperature();
    double* shape = trial_ + problem_.layout.heat_shape;
    for (std::size_t i = static_cast<std::size_t>(l); own.work > 0.0 && i < row(); i += kLanes)
      shape[i] = done_[i] / own.work;
    copy_lane(start_ + first, trial_ + first, static_cast<std::size_t>(problem_.heat_rows) * kLanes, l);
    if (!(own.heat > 0.0)) return;
    found_[l].several = found_[l].several || leaps;
    const double share = leaps ? std::min(1.0, own.work / own.heat) : 1.0;
    add_spread_lane(operators_.heat(), operators_.spread(), l, share, rise_, trial_ + first);
    found_[l].flux = share * own.heat;
    const std::size_t near = problem_.layout.temperature + static_cast<std::size_t>(l);
    for (std::ptrdiff_t i = 0; forced_ && i < vertices(); ++i)
      trial_[near + static_cast<std::size_t>(i) * kLanes] = warmed(l, i, share);
    for (std::size_t i = 0; i < row(); i += kLanes)
      if (double& T = trial_[near + i];
          start_[near + i] < own.T_melt && T >= own.T_melt && T <= own.T_melt * (1.0 + kLeastRoom))
        T = std::nextafter(own.T_melt, 0.0);
  }

  const StepOperators& operators_;
  const InertiaStage& stage_;
  const Problem& problem_ = stage_.problem;
  const TileInputs& inputs_ = stage_.inputs;
  const double* T_old_;  // all temperatures before the step
  const bool forced_ = is_forced(problem_);
  double* trial_ = stage_.trial;
  Found (&found_)[kLanes] = stage_.found;
  // The state before the step, with the temperatures without its heat; velocities of the last evaluation, those from which
  // it was searched, and those of the smallest amount that is enough; and rows [vertex][lane]: work that the vertices do,
  // work of which they take heat, the rise of their temperature. Under force also the right side of what is left to
  // melting, [lane][vertex], what is left without and with heat, and the states on both sides of a leap.
  double* start_ = scratch_tile(Scratch::kWorkHeat, problem_.layout.doubles + 3 * velocities() + 3 * row() +
                                                        (forced_ ? 3 * row() + 2 * problem_.layout.doubles : 0));
  double* guess_ = start_ + problem_.layout.doubles;
  double* used_ = guess_ + velocities();
  double* used_at_high_ = used_ + velocities();
  double* done_ = used_at_high_ + velocities();
  double* power_ = done_ + row();
  double* rise_ = power_ + row();
  double* cold_ = rise_ + row();
  double* room_ = cold_ + row();
  double* left_ = room_ + row();
  double* at_low_ = left_ + row();
  double* at_high_ = at_low_ + problem_.layout.doubles;
  Found found_at_low_[kLanes];
  Lane lanes_[kLanes];
  std::uint32_t lost_ = 0;
};

}  // namespace

std::uint32_t solve_heated_stage(const StepOperators& operators, const InertiaStage& stage, const double* committed,
                                 std::uint32_t lanes) {
  return HeatedWaves(operators, stage, committed).solve(lanes);
}

}  // namespace shearbus::physics
