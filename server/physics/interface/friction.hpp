// The friction law of an interface, as the rest of the model needs it. A law is one file with one class, registered by
// one line in friction_laws.hpp (server/ARCHITECTURE.md, "Adding a law"). The interface carries at most
//
//   |s| <= min(mu(T0, |[v]|) P, yield_strength g(P, T0) / sqrt(3)),                    DLP (5), (65)
//
// and a friction law gives the coefficient mu. The concepts of this file list the members that a law must have.
#pragma once

#include <concepts>
#include <cstdint>
#include <limits>
#include <string_view>
#include <type_traits>

#include "server/physics/interface/friction_form.hpp"
#include "server/physics/material/flow_law.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

enum class FrictionLaw : std::uint8_t {};  // index of a law in the list of friction_laws.hpp; 0: constant mu

struct InterfaceOptions {
  double friction_coefficient = 0.0;            // coefficient mu; if mu varies, its value without slip and below T_ref
  double yield_strength = 0.0;                  // yield strength of the interface  [Pa]
  FrictionLaw friction_law{};                   // law that gives the coefficient mu
  double friction_coefficient_fast = 0.0;       // coefficient mu_inf of velocity weakening at high velocity
  double velocity_decay = 0.0;                  // decay theta of velocity weakening  [s/m]
  double friction_reference_temperature = 0.0;  // reference temperature T_ref of thermal softening   [K]
  double friction_softening_exponent = 0.0;     // exponent m of thermal softening, at least 1
};

// The friction coefficient mu and its derivatives.
struct FrictionValue {
  double coefficient;
  double slope;       // derivative of mu by T0         [1/K]
  double slip_slope;  // derivative of mu by the slip velocity |[v]|   [s/m]
};

// Friction of one step under a law that depends on slip, not on temperature. The slip under the stress a is c - b a
// (FrictionHeating). Temperature changes this slip only through the stress, so friction is solved before the interface
// temperature T0 is known, and the rest of the solver sees a constant limit.
struct SlidingFriction {
  double sliding;  // smallest a >= 0 with a = mu(c - b a) P: the stress of the answer with the most slip  [Pa]
  double holding;  // friction stress mu P at the slip that remains under the sticking stress a_stick  [Pa]
  // Stress above which mu(c - b a) P exceeds a again, because mu rises as the slip falls. The node may then also stick
  // in the same step. Infinity: there is no such stress.
  double exceeds_again = std::numeric_limits<double>::infinity();  // [Pa]
};

// The properties of a friction law. Options of a model are allowed or refused by these properties, never by the name of
// a law. No property has a default: a law that does not declare all of them does not compile.
struct FrictionLawProperties {
  bool depends_on_slip;         // whether mu depends on the slip of the step
  bool depends_on_temperature;  // whether mu depends on T0 at the end of the step
};

template <class Law>
concept DeclaresFrictionLawProperties = requires {
  typename std::bool_constant<Law::kDependsOnSlip>;
  typename std::bool_constant<Law::kDependsOnTemperature>;
};

template <DeclaresFrictionLawProperties Law>
constexpr FrictionLawProperties properties_of_law() {
  return {.depends_on_slip = Law::kDependsOnSlip, .depends_on_temperature = Law::kDependsOnTemperature};
}

// A law whose coefficient falls with T0. Solvers require that mu(T0) is continuous, never rises and is 0
// from T_melt on.
template <class Law>
concept TemperatureDependentFriction =
    !Law::kDependsOnTemperature || requires(const InterfaceOptions& options, const Material& soft, double T) {
  // Upper bound of |d mu / d T0| between two temperatures  [1/K]
  { Law::steepest(options, soft, T, T) } -> std::same_as<double>;
};

// A law whose coefficient depends on slip solves the friction of a step itself.
template <class Law>
concept SlipDependentFriction = !Law::kDependsOnSlip || requires(const InterfaceOptions& options, double value) {
  // of_step gets the options, the pressure P, the coefficients c and b of the slip c - b a, and the sticking stress
  // a_stick.
  { Law::of_step(options, value, value, value, value) } -> std::same_as<SlidingFriction>;
};

// A law may declare a form of its coefficient, equal to at() to rounding (friction_form.hpp).
template <class Law>
concept HasFrictionForm = requires(const InterfaceOptions& options) {
  { Law::form(options) } -> std::same_as<FrictionForm>;
};

template <class Law>
concept FrictionLawClass = DeclaresFrictionLawProperties<Law> && TemperatureDependentFriction<Law> &&
    SlipDependentFriction<Law> && requires(const InterfaceOptions& options, const Material& soft, double value) {
  { Law::kName } -> std::convertible_to<std::string_view>;      // name of the law in scenes
  { Law::kEquation } -> std::convertible_to<std::string_view>;  // equation of the law, for OPTIONS.md
  { Law::kAdds } -> std::convertible_to<std::string_view>;  // what the law adds to constant friction, for OPTIONS.md
  { Law::kWhen } -> std::convertible_to<std::string_view>;  // when to use the law, for OPTIONS.md
  // Checks the constants of the law together. The fault that it returns names a key of the scene table [interface].
  { Law::fault_of(options, soft) } -> std::same_as<LawFault>;
  // Returns the options with typical constants of the law; friction_coefficient and yield_strength stay as given.
  { Law::typical(options, soft) } -> std::same_as<InterfaceOptions>;
  // Returns mu at the interface temperature T0 and slip velocity |[v]|; `soft`: the material at the node's pressure.
  { Law::at(options, soft, value, value) } -> std::same_as<FrictionValue>;
};

}  // namespace shearbus::physics
