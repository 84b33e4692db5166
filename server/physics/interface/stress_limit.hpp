// The strength of the interface (DLP 65): the largest stress that the interface carries at an interface temperature T0
// and a slip,
//
//   s_lim(T0, [v]) = min(mu(T0, [v]) P, Y([v]) g(P, T0) / sqrt(3)),
//
// where Y is a yield strength or the strength of junctions, which grows with the slip of the step. All solvers use this
// object; the ceiling of a layer (Y_max) is a StressLimit without friction.
#pragma once

#include <limits>
#include <optional>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/interface/junctions.hpp"
#include "server/physics/interface/search_effort.hpp"
#include "server/physics/material/strength.hpp"

namespace shearbus::physics {

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
  double share = 1.0;  // factor on the friction stress of the law `varying`; 1 unless scaled() has set it

  struct Value {
    double stress;            // the limit  [Pa]
    double slope;             // derivative of the limit by T0  [Pa/K]
    bool is_coulomb;          // the friction branch is the limit
    double slip_slope = 0.0;  // derivative of the limit by the slip velocity  [Pa s/m]
  };
  Value at(double temperature, double slip = 0.0) const {
    const Softening soften = softening(*soft, pressure, temperature);
    const Junctions::Value hardened = junctions.options ? junctions.at(slip) : Junctions::Value{tresca, 0.0};
    const double yield = hardened.strength * soften.g;
    if (varying == nullptr) {
      if (coulomb <= yield) return {offset + coulomb, 0.0, true};
    } else if (const Value rubbing = friction(temperature, slip); rubbing.stress < yield) {
      return {offset + rubbing.stress, rubbing.slope, true, rubbing.slip_slope};
    }
    return {offset + yield, hardened.strength * soften.slope, false, hardened.slope * soften.g};
  }

  // The friction branch of the limit alone, without `offset`.
  Value friction(double temperature, double slip = 0.0) const {
    if (varying == nullptr) return {coulomb, 0.0, true};
    return varying_friction(temperature, slip);
  }

  // For a friction law that depends on slip: the friction of a step in which the slip velocity is c - b a under the
  // stress a. Empty for other laws. The interface sticks under the stress `a_stick`.
  std::optional<SlidingFriction> friction_of_step(double c, double b, double a_stick) const {
    if (varying == nullptr) return {};
    return varying_friction_of_step(c, b, a_stick);
  }

  // A copy of this limit with a constant friction stress.
  StressLimit with_friction(double stress) const {
    StressLimit other = *this;
    other.coulomb = stress;
    other.varying = nullptr;
    return other;
  }
  // The limit at one slip velocity, as a limit that does not depend on slip any more.
  StressLimit at_slip(double slip) const;
  bool depends_on_slip() const;
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

  // Upper bound of |d stress / d T0| between two temperatures, for slips up to `most_slip`  [Pa/K].
  double steepest(double coldest, double hottest, double most_slip) const;
  // Whether constant friction is the limit at a temperature, and therefore at all lower temperatures.
  bool is_constant_below(double temperature, double slip) const {
    return varying == nullptr && at(temperature, slip).is_coulomb;
  }

 private:
  Value varying_friction(double temperature, double slip) const;
  std::optional<SlidingFriction> varying_friction_of_step(double c, double b, double a_stick) const;
};

// The strength of the interface of one node without its junctions. `soft`: material of the soft body, with its
// properties at the pressure of the node.
inline StressLimit interface_strength(const InterfaceOptions& options, const Material& soft, double pressure,
                                      SearchEffort* effort) {
  StressLimit limit{std::numeric_limits<double>::infinity(), options.yield_strength / kSqrt3, pressure, &soft};
  limit.effort = effort;
  FrictionLaws::with(options.friction_law, [&](auto own) {
    using Law = typename decltype(own)::type;
    if constexpr (Law::kDependsOnSlip || Law::kDependsOnTemperature)
      limit.varying = &options;
    else
      limit.coulomb = Law::at(options, soft, 0.0, 0.0).coefficient * pressure;
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

// Returns true if the spare strength H is sure to have at most one zero in [0, a_max]. This holds if H falls strictly
// up to the limit of the unheated interface, s_lim(T_ad, v(0)), above which H has no zero. H can rise only where more
// stress heats less. There an upper bound of B0 beta_T |ds_lim/dT0| (2 b a - c) must be below 1, with b and c of
// FrictionHeating. Junctions only make H fall faster, because less slip hardens them less.
bool slip_is_unique(const StressLimit& limit, const FrictionHeating& heating, double a_max);

// The smallest zero of the spare strength H in [0, a_max], of however many. The interface slips most under the smallest
// stress.
struct SlipSearch {
  double stress;  // the zero; without a zero the smaller of a_max and the limit of the unheated interface   [Pa]
  bool found;
  bool several;  // the spare strength H has other zeros in [0, a_max]
};
SlipSearch most_slip_stress(const StressLimit& limit, const FrictionHeating& heating, double a_max);

}  // namespace shearbus::physics
