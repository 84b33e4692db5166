// The flow law of a material, as the rest of the model needs it. A law is one file with one class, registered by one
// line in flow_laws.hpp (server/ARCHITECTURE.md, "Adding a law"). The flow stress of a law is
//
//   Y(ep, dep/dt, P, T) = H(ep, dep/dt, P, T) g(P, T)
//
// where H is the hardened strength and g the softening, which is 0 at T_melt and above; the yield strength of the
// interface is multiplied by g too. The solvers need three things of Y: Y never falls with ep and dep/dt, Y never rises
// with T, and Y is 0 from T_melt on. Then every balance of the layer has one root and a bracket. The kernels of a
// separable law, whose H does not depend on P and T, work on logarithms; a law whose rate and temperature are coupled
// has an inverse of its own. The concepts of this file list the members of a law, one requirement with its comment per
// line; the compiler names the members that a new law lacks.
#pragma once

#include <concepts>
#include <string_view>
#include <type_traits>

#include "server/physics/material/material.hpp"

namespace shearbus::physics {

inline constexpr double kSqrt3 = 1.7320508075688772;
inline constexpr double kMeltingFactor = 0.001;  // the factor in exp(-0.001 T/(T_melt - T)), DLP (15)

// The softening g(P, T) and its derivative dg/dT.
struct Softening {
  double g = 0.0;
  double slope = 0.0;
};

// The part of a vertex's excess (SeparableFlowKernel) that is due to the softening g, and its derivative by T.
struct SofteningExcess {
  double value;
  double rate;
};

// N vertices, one per lane, and the stress on each: the input of the kernel of a law that is not separable.
template <int N>
struct LoadedVertices {
  const double* load;          // stress on each vertex, as load_of(a) gives it
  const double* bracket;       // part of the softening g that depends on P, bracket_at(m, P), of each lane
  const double* T_melt;        // melting temperature at P           [K]
  alignas(64) double T[N];     // temperature after the step         [K]
  alignas(64) double rise[N];  // temperature rise by the friction heat of the stress a, a dT/da  [K]
};

// A contradiction between constants of a law that are valid one by one. An empty field means no contradiction.
struct LawFault {
  std::string_view field;  // key of the constant to blame
  std::string_view text;
};

inline constexpr double kMolten = 1e300;  // softening excess where g = 0: the vertex flows under any load but kNoLoad
// Result of load_of() without stress: no vertex yields, not even a molten one.
inline constexpr double kNoLoad = -1e305;
// Largest excess (SeparableFlowKernel) that a kernel uses; a larger excess is cut to this value, so that the strain is
// finite. No host has a strain of that size.
inline constexpr double kMaxExcess = 300.0;

// The properties of a flow law. Options of a model are allowed or refused by these properties, never by the name of a
// law. No property has a default: a law that does not declare all of them does not compile.
struct FlowLawProperties {
  bool depends_on_rate;      // the strength H rises with the strain rate dep/dt
  bool separable;            // H is independent of P and T, so that Y is a product H(ep, dep/dt) g(P, T)
  bool first_order_in_time;  // the stress follows the mean rate of a step, so that the step is of first order
  bool vanishes_at_melting;  // the softening g is 0 at T_melt and above
  bool has_pressure_term;    // the softening g contains gP P, so that Material::pressure_term has an effect
  bool has_ceiling;          // the law has a constant that can limit the strength H (Y_max)
  bool has_wave_return;      // H g is of the form that layers with inertia solve in registers; others in simple code
};

// The constexpr members that every flow law declares.
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

// The functions of a flow law at one point of a layer.
template <class Law>
concept FlowLawFunctions = requires(const Material& m, double ep, double dep, double rate, double dt, double P,
                                    double T) {
  { Law::kName } -> std::convertible_to<std::string_view>;                  // name of the law in scenes
  { Law::kEquation } -> std::convertible_to<std::string_view>;              // source of the law, for OPTIONS.md
  { Law::kAdds } -> std::convertible_to<std::string_view>;                  // effects it describes, for OPTIONS.md
  { Law::kWhen } -> std::convertible_to<std::string_view>;                  // when to use the law, for OPTIONS.md
  { *Law::kConstants.begin() } -> std::convertible_to<double Material::*>;  // the Material members that it uses
  { Law::fault_of(m) } -> std::same_as<LawFault>;                           // checks the constants of the law together
  { Law::softening(m, P, T) } -> std::same_as<Softening>;                   // softening g and its slope dg/dT
  { Law::steepest_softening(m, P, T, T) } -> std::same_as<double>;  // upper bound of |dg/dT| between two temperatures
  { Law::hardened(m, ep, rate, P, T) } -> std::same_as<double>;     // strength H; separable laws ignore P and T
  { Law::hardening_slope(m, ep, dep, dt, P, T) } -> std::same_as<double>;  // hardening slope dH/d(dep) at ep + dep
  { Law::ceiling(m) } -> std::same_as<double>;                             // the largest H; infinity: none
  { Law::hardens(m) } -> std::same_as<bool>;                               // false: H is a constant
};

// The kernel that every law has for the loops over lanes in solver/flow/layer_flow. An object of the law holds its
// constants for one step length.
template <class Law>
concept FlowKernel = std::constructible_from<Law, const Material&, double> &&
    requires(const Law law, const Material& m, double a, double P) {
  { law.load_of(a) } -> std::same_as<double>;         // a stress magnitude in the form that the kernel needs
  { Law::unit_of_load(m) } -> std::same_as<double>;   // stress unit of load_of()  [Pa]
  { Law::bracket_at(m, P) } -> std::same_as<double>;  // part of the softening g that depends on P
};

// The kernel of a separable law. A vertex flows if excess = load_of(a) + softening_excess - log_strength is positive.
// Its strain increment dep then solves H(ep + dep, dep/dt) g = sqrt(3) a, and flow() calls take(lane, dep, slope) with
// slope = a d(dep)/da. Heating by the stress a enters this slope through growth = a d(softening_excess)/da.
// flow() gets the excess, the growth and the old strain ep of each lane.
template <class Law>
concept SeparableFlowKernel = FlowKernel<Law> &&
    requires(const Law law, double bracket, double T_melt, double T, double ep, const double (&packet)[1],
             const double* strain, void (*take)(int lane, double dep, double slope)) {
  { law.log_strength(ep) } -> std::same_as<double>;  // ln(H) at rate 0, scaled as load_of()
  { law.softening_excess(bracket, T_melt, T) } -> std::same_as<SofteningExcess>;  // part of the excess due to g
  law.flow(packet, packet, strain, take);                                         // arguments: excess, growth, ep
};

// The kernel of a law that couples rate and temperature. A vertex flows where load_of(a) > strength_at_rest.
template <class Law>
concept CoupledFlowKernel = FlowKernel<Law> &&
    requires(const Law law, double bracket, double T_melt, double T, double ep, const LoadedVertices<1>& vertices,
             const double (&packet)[1], const double* strain, void (*take)(int lane, double dep, double slope)) {
  { law.strength_at_rest(bracket, T_melt, T, ep) } -> std::same_as<double>;  // Y(ep, 0, P, T) in the units of load_of
  law.flow(vertices, packet, strain, take);                                  // arguments: loads, excess, ep
};

template <class Law>
concept FlowLawClass = DeclaresFlowLawProperties<Law> && Law::kVanishesAtMelting &&  // no stress if molten
    FlowLawFunctions<Law> &&
    ((Law::kSeparable && SeparableFlowKernel<Law>) || (!Law::kSeparable && CoupledFlowKernel<Law>));

}  // namespace shearbus::physics
