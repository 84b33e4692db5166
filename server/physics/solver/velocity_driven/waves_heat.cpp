#include "server/physics/solver/velocity_driven/waves_heat.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "server/physics/material/strength.hpp"
#include "server/physics/solver/flow/root_search.hpp"
#include "server/physics/solver/scratch.hpp"

namespace shearbus::physics {
namespace {

constexpr double kVelocity = 1e-12;     // the velocities of the waves are known to this part of the largest
constexpr double kClosed = 1e-12;       // largest difference of work and heat, relative to the heat
constexpr double kDigits = 1e-9;        // the same where the last digit of a temperature decides, next to melting
constexpr double kLeastRoom = 1e-12;    // a vertex that is nearer to melting takes no heat, relative to T_melt
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
  HeatedWaves(const StepOperators& operators, const InertiaStage& stage) : operators_(operators), stage_(stage) {
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
  struct Lane {
    double amount = 0.0, work = 0.0, heat = 0.0;  // work and heat: powers of the last evaluation  [W/m2]
    double work_before = 0.0;                     // work without heat  [W/m2]
    double low = 0.0, work_at_low = 0.0;          // the largest amount known that is too small, its lack of heat
    double high = 0.0;                            // the smallest amount known that is enough, with an answer
    bool solved = true;                           // the last evaluation has an answer
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
      lanes_[l].heat = lanes_[l].amount > 0.0 ? warm(l) : 0.0;
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

  // Raises the temperatures of the layer in `trial` by the heat of the amount, and returns the sum of this heat. A vertex
  // that its neighbours melt takes none.
  double warm(int l) {
    const double T_melt = lanes_[l].T_melt;
    const double* T_ad = start_ + problem_.layout.temperature + l;
    double* rise = rise_ + l;
    double room[kMaxInertiaCells + 1], flux[kMaxInertiaCells + 1];
    for (std::ptrdiff_t i = 0; i < vertices(); ++i) {
      room[i] = T_melt - T_ad[i * kLanes];
      flux[i] = room[i] > kLeastRoom * T_melt ? lanes_[l].amount * power_[i * kLanes + l] : 0.0;
    }
    for (bool molten = true; molten;) {
      warm_by(flux, room, rise);
      molten = false;
      for (std::ptrdiff_t i = 0; i < vertices(); ++i) {
        if (!(flux[i] > 0.0 && rise[i * kLanes] > room[i] * (1.0 + kLeastRoom))) continue;
        flux[i] = 0.0;
        molten = true;
      }
    }
    double sum = 0.0;
    for (std::ptrdiff_t i = 0; i < vertices(); ++i) {
      trial_[problem_.layout.temperature + static_cast<std::size_t>(i * kLanes + l)] += rise[i * kLanes];
      if (flux[i] > 0.0) sum += flux[i] * std::max(0.0, 1.0 - rise[i * kLanes] / room[i]);
    }
    return sum;
  }

  // The rise of the temperatures of the layer where the vertices take flux (1 - rise/room). The matrix is that of the step
  // with a term more in the diagonal of each heated vertex; `excess` is what they add to its pivots.
  void warm_by(const double* flux, const double* room, double* rise) const {
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
      rise[i * kLanes] = (source + (i < last ? outer * rise[(i + 1) * kLanes] : 0.0)) / pivot;
      inner[i] = i > 0 ? heat.outward[at] * plain / pivot : 0.0;
    }
    for (std::ptrdiff_t i = 1; i <= last; ++i) rise[i * kLanes] += inner[i] * rise[(i - 1) * kLanes];
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
    lanes_[l].unknown = kVelocity * largest * fastest;
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
    }
  }

  // The temperatures at the end of the step, and where its work has heated. They are those of evaluate() but for rounding,
  // which melts no vertex, and leaps, which only cool.
  void heat_up(int l) {
    const Lane& own = lanes_[l];
    const std::size_t first = problem_.layout.first_temperature();
    double* shape = trial_ + problem_.layout.heat_shape;
    for (std::size_t i = static_cast<std::size_t>(l); own.work > 0.0 && i < row(); i += kLanes)
      shape[i] = done_[i] / own.work;
    copy_lane(start_ + first, trial_ + first, static_cast<std::size_t>(problem_.heat_rows) * kLanes, l);
    if (!(own.heat > 0.0)) return;
    const bool leaps = !own.closed(kDigits);
    found_[l].several = found_[l].several || leaps;
    const double share = leaps ? std::min(1.0, own.work / own.heat) : 1.0;
    add_spread_lane(operators_.heat(), operators_.spread(), l, share, rise_, trial_ + first);
    found_[l].flux = share * own.heat;
    const std::size_t near = problem_.layout.temperature + static_cast<std::size_t>(l);
    for (std::size_t i = 0; i < row(); i += kLanes)
      if (double& T = trial_[near + i];
          start_[near + i] < own.T_melt && T >= own.T_melt && T <= own.T_melt * (1.0 + kLeastRoom))
        T = std::nextafter(own.T_melt, 0.0);
  }

  const StepOperators& operators_;
  const InertiaStage& stage_;
  const Problem& problem_ = stage_.problem;
  const TileInputs& inputs_ = stage_.inputs;
  double* trial_ = stage_.trial;
  Found (&found_)[kLanes] = stage_.found;
  // The state before the step, with the temperatures without its heat; velocities of the last evaluation, those from which
  // it was searched, and those of the smallest amount that is enough; and rows [vertex][lane]: work that the vertices do,
  // work of which they take heat, the rise of their temperature.
  double* start_ = scratch_tile(Scratch::kWorkHeat, problem_.layout.doubles + 3 * velocities() + 3 * row());
  double* guess_ = start_ + problem_.layout.doubles;
  double* used_ = guess_ + velocities();
  double* used_at_high_ = used_ + velocities();
  double* done_ = used_at_high_ + velocities();
  double* power_ = done_ + row();
  double* rise_ = power_ + row();
  Lane lanes_[kLanes];
  std::uint32_t lost_ = 0;
};

}  // namespace

std::uint32_t solve_heated_stage(const StepOperators& operators, const InertiaStage& stage, std::uint32_t lanes) {
  return HeatedWaves(operators, stage).solve(lanes);
}

}  // namespace shearbus::physics
