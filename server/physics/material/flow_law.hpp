// What a law of the flow stress is to the rest of the model (server/ARCHITECTURE.md, "Adding a law"): one file with one
// class, registered by one line in flow_laws.hpp. Every law is a product,
//
//   Y(ep, dep/dt, P, T) = H(ep, dep/dt) g(P, T),   H rising with strain and rate, g falling to 0 at T_melt,
//
// and offers, as statics and as an object that holds its constants for one step length:
//
//   kName                                    what scenes call it
//   kConstants                               members of Material that are its own; no other constant of a strength is
//   used fault_of(m)                              what is wrong with its constants together softening(m, P, T) g and
//   dg/dT steepest_softening(m, P, coldest, hottest)   an upper bound of |dg/dT| between two temperatures hardened(m,
//   ep, rate)                    H hardening_slope(m, ep, dep, dt)          dH/d(dep) where a step of dt brings dep
//   ceiling(m)                               what H cannot pass; infinity: nothing
//   hardens(m)                               whether H rises at all
//
//   Law(m, dt)                               constants of the lane kernels of solver/flow/layer_flow:
//   log_load(a)                              of a stress magnitude
//   bracket_at(m, P)                         what g needs of the pressure
//   log_strength(ep)                         of what has flowed before
//   softening_excess(bracket, T_melt, T)     of a temperature
//   flow(excess, growth, ep, take)           a packet of vertices under their excesses: take(lane, dep, slope) of each
//
// A vertex flows where excess = log_load + softening_excess - log_strength is positive, by dep with H(ep + dep, dep/dt)
// g = sqrt(3) a. `slope` is a d(dep)/da, heating by a included through growth = a d(softening_excess)/da.
#pragma once

#include <string_view>

namespace shearbus::physics {

inline constexpr double kSqrt3 = 1.7320508075688772;

// g(P, T) and dg/dT.
struct Softening {
  double g = 0.0;
  double slope = 0.0;
};

// The share of excess that temperature makes, and its derivative with respect to T.
struct SofteningExcess {
  double value;
  double rate;
};

// What is wrong with a law's constants together; an empty field: nothing.
struct LawFault {
  std::string_view field;
  std::string_view text;
};

inline constexpr double kMolten = 1e300;   // softening excess where g = 0: any load flows, kNoLoad does not
inline constexpr double kNoLoad = -1e305;  // log_load under which nothing yields, however hot
inline constexpr double kMaxExcess =
    300.0;  // cut here: the strain is then beyond anything a host imposes, and a number

}  // namespace shearbus::physics
