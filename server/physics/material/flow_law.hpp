// The flow law of a material, as the rest of the model needs it. A law is one file with one class, registered by one
// line in flow_law_list.hpp (server/ARCHITECTURE.md, "Adding a law"). The flow stress of a law is
//
//   Y(ep, dep/dt, P, T) = H(ep, dep/dt, P, T) g(P, T)
//
// where H is the hardened strength and g the softening, which is 0 at T_melt and above; the yield strength of the
// interface is multiplied by g too. The solvers need three things of Y: Y never falls with ep and dep/dt, Y never rises
// with T, and Y is 0 from T_melt on. Then every balance of the layer has one root and a bracket.
//
// The text of a law is written in registers (layer/register.hpp). It is compiled for one double, for points of a layer,
// and for each register width, for the sums over a tile, so it has no include guard. The concepts of this file list the
// members of a law, one requirement with its comment per line; the compiler names the members that a new law lacks.
#pragma once

#include <concepts>
#include <string_view>
#include <type_traits>

#include "server/physics/layer/registers.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

inline constexpr double kSqrt3 = 1.7320508075688772;
inline constexpr double kMeltingFactor = 0.001;  // the factor in exp(-0.001 T/(T_melt - T)), DLP (15)

// A contradiction between constants of a law that are valid one by one. An empty field means no contradiction.
struct LawFault {
  std::string_view field;  // key of the constant to blame
  std::string_view text;
};

inline namespace point {
#include "server/physics/material/flow_at_vertex.hpp"
}  // namespace point

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

// The functions of a flow law at points of a layer; each Register holds one point per lane.
template <class Law>
concept FlowLawFunctions = requires(const Material& m, Register ep, Register dep, Register rate, double dt, Register P,
                                    Register T) {
  { Law::kName } -> std::convertible_to<std::string_view>;      // name of the law in scenes
  { Law::kEquation } -> std::convertible_to<std::string_view>;  // source of the law, for shearbus-ctl options
  { Law::kAdds } -> std::convertible_to<std::string_view>;      // effects it describes, for shearbus-ctl options
  { Law::kWhen } -> std::convertible_to<std::string_view>;      // when to use the law, for shearbus-ctl options
  { *Law::kConstants.begin() } -> std::convertible_to<double Material::*>;  // the Material members that it uses
  { Law::fault_of(m) } -> std::same_as<LawFault>;                           // checks the constants of the law together
  { Law::softening(m, P, T) } -> std::same_as<Softening>;                   // softening g and its slope dg/dT
  { Law::steepest_softening(m, P, T, T) } -> std::same_as<Register>;  // upper bound of |dg/dT| between two temperatures
  { Law::hardened(m, ep, rate, P, T) } -> std::same_as<Register>;     // strength H; separable laws ignore P and T
  { Law::hardening_slope(m, ep, dep, dt, P, T) } -> std::same_as<Register>;  // hardening slope dH/d(dep) at ep + dep
  { Law::ceiling(m) } -> std::same_as<double>;                               // the largest H; infinity: none
  { Law::hardens(m) } -> std::same_as<bool>;                                 // false: H is a constant
};

// The flow of a law whose strain increment is an explicit function of the stress. An object holds the constants of the
// law for one step length, and a load.
template <class Law>
concept ExplicitFlow = std::constructible_from<Law, const Material&, double, const VertexLoad&> &&
    requires(const Law law, const Material& m, Register T, Register rise) {
  { law.expand(T, rise) } -> std::same_as<Expansion>;       // the flow of a vertex at T, of which the heat made `rise`
  { Law::exponent(m) } -> std::same_as<double>;             // exponent of the stress in the strain increment
  { Law::cold_without_strain(m) } -> std::same_as<double>;  // Expansion::cold less ep
};

// The flow of a law whose strain increment is searched for at each vertex.
template <class Law>
concept SearchedFlow = std::constructible_from<Law, const Material&, double, const VertexLoad&> &&
    requires(const Law law, const LoadedVertex& vertex) {
  { law.flow(vertex) } -> std::same_as<VertexFlow>;
};

template <class Law>
concept FlowLawClass = DeclaresFlowLawProperties<Law> && Law::kVanishesAtMelting &&  // no stress if molten
    FlowLawFunctions<Law> &&(ExplicitFlow<Law> || SearchedFlow<Law>);

}  // namespace shearbus::physics
