// The stress the interface can carry (DLP 65, and the ceiling of a layer with Y_max): min(coulomb, tresca g(P, T0)),
// where junctions make `tresca` grow with the slip of the step.
#pragma once

#include "server/physics/interface/junctions.hpp"
#include "server/physics/interface/search_effort.hpp"
#include "server/physics/material/strength.hpp"

namespace shearbus::physics {

struct StressLimit {
  double coulomb;   // what friction carries; infinity: no such limit          [Pa]
  double tresca;    // yield strength / sqrt(3), where there are no junctions  [Pa]
  double pressure;  // P                               [Pa]
  const Material* soft;
  Junctions junctions = {};
  double offset = 0.0;  // added to the lesser of the two  [Pa]
  SearchEffort* effort = nullptr;

  struct Value {
    double stress;  // [Pa]
    double slope;   // d stress / d T0  [Pa/K]
    bool is_coulomb;
    double slip_slope = 0.0;  // d stress / d slip  [Pa s/m]
  };
  Value at(double temperature, double slip = 0.0) const {
    const Softening soften = softening(*soft, pressure, temperature);
    const Junctions::Value hardened = junctions.options ? junctions.at(slip) : Junctions::Value{tresca, 0.0};
    const double yield = hardened.strength * soften.g;
    if (coulomb <= yield) return {offset + coulomb, 0.0, true};
    return {offset + yield, hardened.strength * soften.slope, false, hardened.slope * soften.g};
  }

  // The same under this friction.
  StressLimit beside(double friction) const { return {friction, tresca, pressure, soft, junctions, offset, effort}; }

  // Upper bound of |d stress / d T0| between two temperatures, for slips up to `most_slip`.
  double steepest(double coldest, double hottest, double most_slip) const;
};

// Friction heats the interface it acts on: T0(a) = T_ad + rise * a * max(0, v(a)) with the slip v(a) = c - b a.
struct FrictionHeating {
  double T_ad;  // interface temperature after a step without friction   [K]
  double rise;  // beta_T B0                                             [K m2/W]
  double c;     // slip without friction                                 [m/s]
  double b;     // slip lost per stress; 0: imposed slip                 [m/(s Pa)]

  double slip(double a) const { return c - b * a > 0.0 ? c - b * a : 0.0; }
  double temperature(double a) const { return T_ad + rise * (a * slip(a)); }
};

// H(a) = s_lim(T0(a), v(a)) - a: positive where the interface can carry more than a.
double spare_strength(const StressLimit& limit, const FrictionHeating& heating, double a);

// The stress in [0, a_max] with H = 0 where H has one zero there (or none: then a_max, which the interface carries).
double slip_stress(const StressLimit& limit, const FrictionHeating& heating, double a_max, double guess);

// `a`, or the last stress below it under which the interface, heated by partition * work, stays below T_melt, where it
// was below: an ulp of temperature can be more than all that is left to melting.
double below_melting(const StressLimit& limit, const FrictionHeating& heating, double partition, double B0, double a);

// Whether H falls strictly on [0, a_max], so that its zero is the only one: B0 beta_T |ds_lim/dT0| (2 b a - c) < 1.
// (Junctions only make it fall faster: less slip hardens them less.)
bool slip_is_unique(const StressLimit& limit, const FrictionHeating& heating, double a_max);

// The smallest zero of H in [0, a_max], which is the answer with the most slip, whatever H does behind it.
struct SlipSearch {
  double stress;  // a_max or the limit there, where there is no zero   [Pa]
  bool found;
  bool several;  // H has other zeros in [0, a_max]
};
SlipSearch most_slip_stress(const StressLimit& limit, const FrictionHeating& heating, double a_max);

}  // namespace shearbus::physics
