// The friction law of an interface, as the rest of the model needs it. A law is one file with one class, registered by
// one line in friction_laws.hpp (server/ARCHITECTURE.md, "Adding a law"). The interface carries at most
//
//   |s| <= min(friction(T0, |[v]|, P, state), yield_strength g(P, T0) / sqrt(3)),         DLP (5), (65)
//
// and a friction law gives the friction. The concepts of this file list the members that a law must have. No solver
// knows a law's name: it asks for the friction and for what the law declares.
#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>

#include "server/physics/interface/friction_form.hpp"
#include "server/physics/interface/friction_law.h"
#include "server/physics/material/flow_law.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::physics {

enum class FrictionLaw : std::uint8_t {};  // index of a law in the list of friction_laws.hpp; 0: constant mu

enum class StateEvolution : std::uint8_t { kAgeing, kSlip };

struct InterfaceOptions {
  double friction_coefficient = 0.0;            // coefficient mu; if mu varies, its value without slip and below T_ref
  double yield_strength = 0.0;                  // yield strength of the interface  [Pa]
  FrictionLaw friction_law{};                   // law that gives the coefficient mu
  double friction_coefficient_fast = 0.0;       // coefficient mu_inf of velocity weakening at high velocity
  double velocity_decay = 0.0;                  // decay theta of velocity weakening  [s/m]
  double friction_reference_temperature = 0.0;  // reference temperature T_ref of thermal softening   [K]
  double friction_softening_exponent = 0.0;     // exponent m of thermal softening, at least 1
  double slip_length = 0.0;                     // slip over which the state of a law follows  [m]
  double reference_velocity = 0.0;              // V* of Prakash and Clifton, V0 of rate and state  [m/s]
  double direct_effect = 0.0;                   // a of rate and state
  double evolution_effect = 0.0;                // b of rate and state
  StateEvolution state_evolution{};             // evolution of the state of rate and state
  const shearbus_friction_law* own = nullptr;   // a law of a library (own.hpp)
};

// The slip velocity |[v]| of a step, given twice: the friction of a law never falls where `up` rises and never rises
// where `down` rises. With up = down it is the friction of the law. So the friction between two slips is known from
// their ends, and a search can prove that no answer lies between two stresses.
struct Slip {
  double up, down;                                                   // [m/s]
  constexpr Slip(double velocity) : up(velocity), down(velocity) {}  // NOLINT: a velocity is a Slip
  constexpr Slip(double rising, double falling) : up(rising), down(falling) {}
};

// Where a law is asked for its friction: at the end of a step of length dt that slips with one velocity.
struct ContactPoint {
  double pressure;                // P; 0 where the contact is open  [Pa]
  double temperature;             // interface temperature T0 at the end of the step  [K]
  Slip slip;                      // |[v]| in the step
  double dt = 0.0;                // [s]
  const double* state = nullptr;  // states of the law before the step, in the order of its kStates
};

// Friction, and its derivatives by T0 and by either slip.
struct FrictionValue {
  double stress;            // [Pa]
  double slope = 0.0;       // [Pa/K]
  double up_slope = 0.0;    // [Pa s/m]
  double down_slope = 0.0;  // [Pa s/m]
};

// The properties of a friction law. Options of a model are allowed or refused by these properties, never by the name of
// a law. No property has a default: a law that does not declare all of them does not compile.
struct FrictionLawProperties {
  bool rises_with_slip;         // whether the friction may rise with the slip of the step
  bool falls_with_slip;         // whether the friction may fall with the slip of the step
  bool depends_on_temperature;  // whether the friction depends on T0 at the end of the step
  bool depends_on_slip() const { return rises_with_slip || falls_with_slip; }
};

template <class Law>
concept DeclaresFrictionLawProperties = requires {
  typename std::bool_constant<Law::kRisesWithSlip>;
  typename std::bool_constant<Law::kFallsWithSlip>;
  typename std::bool_constant<Law::kDependsOnTemperature>;
};

template <DeclaresFrictionLawProperties Law>
constexpr FrictionLawProperties properties_of_law() {
  return {.rises_with_slip = Law::kRisesWithSlip,
          .falls_with_slip = Law::kFallsWithSlip,
          .depends_on_temperature = Law::kDependsOnTemperature};
}

// A law whose friction falls with T0. Solvers require that it is continuous, never rises with T0 and is 0 from T_melt
// on.
template <class Law>
concept TemperatureDependentFriction =
    !Law::kDependsOnTemperature ||
    requires(const InterfaceOptions& options, const Material& soft, const ContactPoint& point, double T) {
  // Upper bound of |d friction / d T0| between two temperatures, at the pressure and states of `point`  [Pa/K]
  { Law::steepest(options, soft, point, T, T) } -> std::same_as<double>;
};

// A law with states of its own, one value per node each, 0 at the start of a node.
template <class Law>
concept FrictionWithState = requires {
  Law::kStates;
};
template <class Law>
concept AdvancesItsStates =
    !FrictionWithState<Law> || requires(const InterfaceOptions& options, const ContactPoint& point, double* state) {
  // Writes the states after the step that `point` describes; `state` may be point.state. An open contact has P = 0.
  { Law::advance(options, point, state) } -> std::same_as<void>;
};
inline constexpr std::size_t kMostFrictionStates = 4;  // largest number of states of a law
using FrictionStates = std::array<double, kMostFrictionStates>;

// A law may declare a form of its coefficient, equal to at() over P to rounding (friction_form.hpp).
template <class Law>
concept HasFrictionForm = requires(const InterfaceOptions& options) {
  { Law::form(options) } -> std::same_as<FrictionForm>;
};

template <class Law>
concept FrictionLawClass = DeclaresFrictionLawProperties<Law> && TemperatureDependentFriction<Law> &&
    AdvancesItsStates<Law> &&
    requires(const InterfaceOptions& options, const Material& soft, const ContactPoint& point) {
  { Law::kName } -> std::convertible_to<std::string_view>;      // name of the law in scenes
  { Law::kEquation } -> std::convertible_to<std::string_view>;  // equation of the law, for shearbus-ctl options
  { Law::kAdds } -> std::convertible_to<std::string_view>;      // what it adds to constant friction, for the same
  { Law::kWhen } -> std::convertible_to<std::string_view>;      // when to use the law, for the same
  // Checks the constants of the law together. The fault that it returns names a key of the scene table [interface].
  { Law::fault_of(options, soft) } -> std::same_as<LawFault>;
  // Returns the options with typical constants of the law; friction_coefficient and yield_strength stay as given.
  { Law::typical(options, soft) } -> std::same_as<InterfaceOptions>;
  // Returns the friction at a point; `soft`: the material at the node's pressure.
  { Law::at(options, soft, point) } -> std::same_as<FrictionValue>;
};

}  // namespace shearbus::physics
