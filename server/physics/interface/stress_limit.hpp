// The strength of the interface (DLP 65): the largest stress that the interface carries at an interface temperature T0
// and a slip,
//
//   s_lim(T0, [v]) = min(friction(T0, [v], P, state), Y([v]) g(P, T0) / sqrt(3)),
//
// where Y is a yield strength or the strength of junctions, which grows with the slip of the step. All solvers use this
// object; the ceiling of a layer (Y_max) is a StressLimit without friction, and an infinite yield strength is none.
#pragma once

#include <cmath>
#include <limits>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/interface/junctions.hpp"
#include "server/physics/interface/search_effort.hpp"
#include "server/physics/material/strength.hpp"

namespace shearbus::physics {

// A slip below this share of all that could slip is rounding: the interface sticks.
inline constexpr double kAtRest = 1e-8;

struct StressLimit {
  // Friction stress mu P of the law with a constant mu; infinity: no friction limit  [Pa]
  double coulomb = std::numeric_limits<double>::infinity();
  double tresca = 0.0;    // shear strength of an interface without junctions: yield strength / sqrt(3)  [Pa]
  double pressure = 0.0;  // normal pressure P  [Pa]
  const Material* soft = nullptr;
  Junctions junctions = {};        // junctions of the node and their plastic strain
  double offset = 0.0;             // stress added to the limit, be it friction or yield: the `shift` of scaled()  [Pa]
  SearchEffort* effort = nullptr;  // where searches for a root count their evaluations; null: no counts
  const InterfaceOptions* varying = nullptr;  // friction law that is not constant; if set, `coulomb` is not used
  double share = 1.0;        // factor on the friction stress of the law `varying`; 1 unless scaled() has set it
  double dt = 0.0;           // length of the step, for the states of the law  [s]
  FrictionStates state{};    // states of the law before the step
  double least_slip = 0.0;   // slower slip has the friction of this slip velocity  [m/s]
  double held_slip = kFree;  // slip velocity at which at_slip() holds the law; kFree: that of the caller

  static constexpr double kFree = -1.0;

  struct Value {
    double stress;          // the limit  [Pa]
    double slope;           // derivative of the limit by T0  [Pa/K]
    bool is_coulomb;        // the friction branch is the limit
    double up_slope = 0.0;  // derivatives of the limit by either slip velocity  [Pa s/m]
    double down_slope = 0.0;
    double slip_slope() const { return up_slope + down_slope; }
  };
  Value at(double temperature, Slip slip = 0.0) const {
    const Softening soften = softening(*soft, pressure, temperature);
    const Junctions::Value hardened = junctions.options ? junctions.at(slip.up) : Junctions::Value{tresca, 0.0};
    const double yield = hardened.strength * soften.g;
    if (varying == nullptr) {
      if (coulomb <= yield || std::isinf(hardened.strength)) return {offset + coulomb, 0.0, true};
    } else if (const Value rubbing = friction(temperature, slip);
               !(rubbing.stress >= yield) || std::isinf(hardened.strength)) {  // also where a law gave no number
      return {offset + rubbing.stress, rubbing.slope, true, rubbing.up_slope, rubbing.down_slope};
    }
    return {offset + yield, hardened.strength * soften.slope, false, hardened.slope * soften.g};
  }

  // Whether the limit, if it is constant friction and one yield strength, is sure to be above a stress. Costs less than
  // at().
  bool surely_carries(double stress, double temperature) const {
    constexpr double kBeyond = 1.0 + 1e-9;  // far above the rounding of at()
    return varying == nullptr && junctions.options == nullptr && offset == 0.0 && coulomb >= stress &&
           !soft->varies_with_compression() &&
           tresca * least_softening(*soft, pressure, temperature) >= kBeyond * stress;
  }

  // The friction branch of the limit alone, without `offset`.
  Value friction(double temperature, Slip slip = 0.0) const {
    if (varying == nullptr) return {coulomb, 0.0, true};
    return varying_friction(temperature, slip);
  }
  // The states of the friction law after the step with this slip velocity.
  FrictionStates states_after(double temperature, double slip) const;

  // The limit at one slip velocity, as a limit that does not depend on slip any more.
  StressLimit at_slip(double slip) const;
  bool depends_on_slip() const {
    return junctions.options != nullptr ||
           (varying != nullptr && properties_of(varying->friction_law).depends_on_slip());
  }
  bool falls_with_slip() const;  // whether the limit may fall with slip, so that a step may have several answers
  // The limit in a stage of a second-order step: both branches (friction and yield) times `factor`, plus `shift`. Not
  // for junctions.
  StressLimit scaled(double factor, double shift) const {
    StressLimit other = *this;
    other.coulomb *= factor;
    other.tresca *= factor;
    other.share *= factor;
    other.offset = shift;
    return other;
  }

  bool vanishes_at_melting() const {
    return !std::isinf(tresca) || junctions.options != nullptr || (varying != nullptr && falls_with_temperature());
  }
  // Upper bound of |d stress / d T0| between two temperatures, for slips up to `most_slip`  [Pa/K].
  double steepest(double coldest, double hottest, double most_slip) const;
  // Whether constant friction is the limit at a temperature, and therefore at all lower temperatures.
  bool is_constant_below(double temperature, Slip slip) const {
    return varying == nullptr && at(temperature, slip).is_coulomb;
  }

 private:
  Value varying_friction(double temperature, Slip slip) const;
  bool falls_with_temperature() const;
};

// The strength of the interface of one node without its junctions. `soft`: material of the soft body, with its
// properties at the pressure of the node.
inline StressLimit interface_strength(const InterfaceOptions& options, const Material& soft, double pressure,
                                      SearchEffort* effort) {
  StressLimit limit{std::numeric_limits<double>::infinity(), options.yield_strength / kSqrt3, pressure, &soft};
  limit.effort = effort;
  FrictionLaws::with(options.friction_law, [&](auto own) {
    using Law = typename decltype(own)::type;
    if constexpr (Law::kRisesWithSlip || Law::kFallsWithSlip || Law::kDependsOnTemperature || FrictionWithState<Law>)
      limit.varying = &options;
    else
      limit.coulomb = Law::at(options, soft, {pressure, 0.0, 0.0}).stress;
  });
  return limit;
}

// Friction heats the interface: T0(a) = T_ad + rise * a * max(0, v(a)) with the slip v(a) = c - b a.
struct FrictionHeating {
  double T_ad;  // interface temperature after a step without friction   [K]
  double rise;  // temperature rise per friction power, beta_T B0         [K m2/W]
  double c;     // slip velocity without friction                        [m/s]
  double b;     // fall of the slip velocity per stress; 0: the slip is imposed  [m/(s Pa)]

  double slip(double a) const { return c - b * a > 0.0 ? c - b * a : 0.0; }
  double temperature(double a) const { return T_ad + rise * (a * slip(a)); }
};

// The spare strength H(a) = s_lim(T0(a), v(a)) - a of the interface  [Pa]: positive if the interface can carry more
// than the stress a.
double spare_strength(const StressLimit& limit, const FrictionHeating& heating, double a);

// Finds the zero of the spare strength H in [0, a_max], where H has at most one. Without a zero the result is a_max,
// because the interface then carries a_max  [Pa]. The search starts at `guess`. Returns NaN if it fails.
double slip_stress(const StressLimit& limit, const FrictionHeating& heating, double a_max, double guess);

// Lowers a stress `a` until the friction heat leaves the interface temperature below T_melt. `partition`: share of the
// friction work that heats the bodies. Returns `a` unchanged if the interface is molten even without this heat. Needed
// because the temperature found for a solid interface may round to T_melt.
double below_melting(const StressLimit& limit, const FrictionHeating& heating, double partition, double B0, double a);

// Returns true if the spare strength H is sure to have at most one zero in [0, a_max] as far as heat can tell. This holds
// if H falls strictly up to the limit of the unheated interface, s_lim(T_ad), above which H has no zero, but for what a
// limit that falls with slip adds (falls_with_slip()). H can rise only where more stress heats less. There an upper bound
// of B0 beta_T |ds_lim/dT0| (2 b a - c) must be below 1, with b and c of FrictionHeating. A limit that rises with slip
// only makes H fall faster.
bool slip_is_unique(const StressLimit& limit, const FrictionHeating& heating, double a_max);

// The smallest zero of the spare strength H in [0, a_max], of however many. The interface slips most under the smallest
// stress.
struct SlipSearch {
  double stress;  // the zero; without a zero the smaller of a_max and the limit of the unheated interface   [Pa]
  bool found;
  bool several;  // the spare strength H has other zeros in [0, a_max]
};
SlipSearch most_slip_stress(const StressLimit& limit, const FrictionHeating& heating, double a_max);

// The smallest a >= 0 that is the friction at the slip velocity max(0, c - b a), for an interface that does not heat and
// yields nowhere  [Pa]. Where it would carry more than the stress that stops it, the friction at rest.
double sliding_stress(const InterfaceOptions& options, const Material& soft, double pressure, double c, double b);

}  // namespace shearbus::physics
