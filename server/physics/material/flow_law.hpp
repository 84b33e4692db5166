// The flow law of a material, as the rest of the model needs it. A law is one file with one class, registered by one
// line in flow_laws.hpp (server/ARCHITECTURE.md, "Adding a law"). The flow stress of a law is
//
//   Y(ep, dep/dt, P, T) = H g(P, T)
//
// where g is the softening, which falls to 0 at T_melt, and H is the hardened strength. The concepts below list what a
// law must offer, one requirement and one comment a line; the compiler names what a new law lacks.
#pragma once

#include <concepts>
#include <string_view>
#include <type_traits>

#include "server/physics/material/material.hpp"

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

// A fault in the constants of a law that no constant shows alone; an empty field: no fault.
struct LawFault {
  std::string_view field;
  std::string_view text;
};

inline constexpr double kMolten = 1e300;   // softening excess where g = 0: any load flows, kNoLoad does not
inline constexpr double kNoLoad = -1e305;  // log_load under which nothing yields, however hot
inline constexpr double kMaxExcess =
    300.0;  // larger excess is cut to this: the strain is beyond any host's, and finite

// The properties of a flow law. Options of a model are allowed or refused by them, never by the name of a law. None has
// a default: a law that does not declare all of them does not compile.
struct FlowLawProperties {
  bool depends_on_rate;      // H rises with dep/dt
  bool separable;            // H does not depend on P and T: Y is a product H(ep, dep/dt) g(P, T)
  bool first_order_in_time;  // the stress follows the mean rate of a step, so that the step is of first order
  bool vanishes_at_melting;  // g is 0 at T_melt and above
  bool has_pressure_term;    // g depends on P directly (gP P), so that PressureTerm means something
  bool has_ceiling;          // a largest H exists (Y_max) for some constants
  bool has_wave_return;      // solver/layer_waves knows the return of a stress to the flow stress of the law
};

// The constexpr members that every law declares.
template <class Law>
concept DeclaresFlowLawProperties = requires {
  typename std::bool_constant<Law::kDependsOnRate>;
  typename std::bool_constant<Law::kSeparable>;
  typename std::bool_constant<Law::kFirstOrderInTime>;
  typename std::bool_constant<Law::kVanishesAtMelting>;
  typename std::bool_constant<Law::kHasPressureTerm>;
  typename std::bool_constant<Law::kHasCeiling>;
  typename std::bool_constant<Law::kHasWaveReturn>;
};

template <DeclaresFlowLawProperties Law>
constexpr FlowLawProperties properties_of_law() {
  return {.depends_on_rate = Law::kDependsOnRate,
          .separable = Law::kSeparable,
          .first_order_in_time = Law::kFirstOrderInTime,
          .vanishes_at_melting = Law::kVanishesAtMelting,
          .has_pressure_term = Law::kHasPressureTerm,
          .has_ceiling = Law::kHasCeiling,
          .has_wave_return = Law::kHasWaveReturn};
}

// The law as point functions.
template <class Law>
concept FlowLawFunctions = requires(const Material& m, double ep, double dep, double rate, double dt, double P,
                                    double T) {
  { Law::kName } -> std::convertible_to<std::string_view>;                  // the word of scenes
  { *Law::kConstants.begin() } -> std::convertible_to<double Material::*>;  // the members that the law uses
  { Law::fault_of(m) } -> std::same_as<LawFault>;                           // a fault of its constants together
  { Law::softening(m, P, T) } -> std::same_as<Softening>;                   // g and dg/dT
  { Law::steepest_softening(m, P, T, T) } -> std::same_as<double>;          // bound of |dg/dT| from T to T
  { Law::hardened(m, ep, rate) } -> std::same_as<double>;                   // H
  { Law::hardening_slope(m, ep, dep, dt) } -> std::same_as<double>;         // dH/d(dep) at ep + dep, dep/dt
  { Law::ceiling(m) } -> std::same_as<double>;                              // the largest H; infinity: none
  { Law::hardens(m) } -> std::same_as<bool>;                                // false: H is a constant
};

// The lane kernels of a separable law (solver/flow/layer_flow). A vertex flows where
//   excess = log_load + softening_excess - log_strength
// is positive, by dep with H(ep + dep, dep/dt) g = sqrt(3) a. `slope` is a d(dep)/da; heating by a enters through
// growth = a d(softening_excess)/da.
template <class Law>
concept SeparableFlowKernel = std::constructible_from<Law, const Material&, double> &&  // constants for one step length
    requires(const Law law, const Material& m, double value, const double (&packet)[1], const double* ep,
             void (*take)(int lane, double dep, double slope)) {
  { law.log_load(value) } -> std::same_as<double>;                                 // of a stress magnitude a
  { Law::bracket_at(m, value) } -> std::same_as<double>;                           // what g needs of P
  { law.log_strength(value) } -> std::same_as<double>;                             // of ep
  { law.softening_excess(value, value, value) } -> std::same_as<SofteningExcess>;  // of bracket, T_melt, T
  law.flow(packet, packet, ep, take);                                              // of excess, growth, ep
};

template <class Law>
concept FlowLawClass = DeclaresFlowLawProperties<Law> && Law::kVanishesAtMelting &&  // a molten vertex carries nothing
    FlowLawFunctions<Law> && SeparableFlowKernel<Law>;

}  // namespace shearbus::physics
