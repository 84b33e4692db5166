// The stress the interface can carry (DLP 65, and the ceiling of a layer with Y_max): min(coulomb, tresca g(P, T0)).
#pragma once

#include "server/physics/material/strength.hpp"

namespace shearbus::physics {

struct StressLimit {
  double coulomb;   // mu P; infinity: no such limit   [Pa]
  double tresca;    // yield strength / sqrt(3)        [Pa]
  double pressure;  // P                               [Pa]
  const Material* soft;
  double offset = 0.0;  // added to the lesser of the two  [Pa]

  struct Value {
    double stress;  // [Pa]
    double slope;   // d stress / d T0  [Pa/K]
    bool is_coulomb;
  };
  Value at(double temperature) const {
    const Softening soften = softening(*soft, pressure, temperature);
    const double yield = tresca * soften.g;
    if (coulomb <= yield) return {offset + coulomb, 0.0, true};
    return {offset + yield, tresca * soften.slope, false};
  }

  // Upper bound of |d stress / d T0| between two temperatures. As exp(-c/x)/x^2 in the distance x from melting the
  // steep part of g' has its only maximum at x = c/2.
  double steepest(double coldest, double hottest) const;
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

// H(a) = s_lim(T0(a)) - a: positive where the interface can carry more than a.
double spare_strength(const StressLimit& limit, const FrictionHeating& heating, double a);

// The stress in [0, a_max] with H = 0 where H has one zero there (or none: then a_max, which the interface carries).
double slip_stress(const StressLimit& limit, const FrictionHeating& heating, double a_max, double guess);

// Whether H falls strictly on [0, a_max], so that its zero is the only one: B0 beta_T |ds_lim/dT0| (2 b a - c) < 1.
bool slip_is_unique(const StressLimit& limit, const FrictionHeating& heating, double a_max);

// The smallest zero of H in [0, a_max], which is the answer with the most slip, whatever H does behind it.
struct SlipSearch {
  double stress;  // a_max or the limit there, where there is no zero   [Pa]
  bool found;
  bool several;  // H has other zeros in [0, a_max]
};
SlipSearch most_slip_stress(const StressLimit& limit, const FrictionHeating& heating, double a_max);

}  // namespace shearbus::physics
