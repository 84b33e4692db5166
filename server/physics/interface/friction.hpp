// What a law of dry friction is to the force-driven step (server/ARCHITECTURE.md, "Adding a law"): one file with one
// class, registered by one line in friction_laws.hpp. The interface law is
//
//   |s| <= min(mu(|[v]|) P, yield_strength g(P, T0) / sqrt(3)),                    DLP (5), (65)
//
// and a friction law is the branch mu(|[v]|). It offers
//
//   kName                                  what scenes call it
//   friction(options, P, c, b, a_stick)    its stresses in a step whose slip is c - b a, 0 where that is negative
#pragma once

#include <cstdint>
#include <limits>

namespace shearbus::physics {

enum class FrictionLaw : std::uint8_t {};  // place in the list of friction_laws.hpp; 0: constant

struct InterfaceOptions {
  double friction_coefficient = 0.0;  // mu, or mu_0 at rest
  double yield_strength = 0.0;        // [Pa]
  FrictionLaw friction_law{};
  double friction_coefficient_fast = 0.0;  // mu_inf; of laws that depend on velocity
  double velocity_decay = 0.0;             // theta  [s/m]
};

// Since slip does not depend on temperature but through the stress, a step in which mu(c - b a) P holds the stress has
// its answer before T0 is known: a constant limit for the rest of the solver.
struct Friction {
  double sliding;  // smallest a >= 0 with a = mu(c - b a) P: of the states that slip, the one that slips most  [Pa]
  double holding;  // mu P at the slip of a = a_stick: what an interface that sticks can count on               [Pa]
  // From this stress on friction carries more than asked again, because less slip makes it stronger: beside the sliding
  // state there may be others. Infinity: nowhere.
  double regained = std::numeric_limits<double>::infinity();  // [Pa]
};

}  // namespace shearbus::physics
