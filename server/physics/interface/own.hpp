// A friction law from outside of the tree (friction_law.h), which the administrator of a server loads. What it declares is
// known when it is loaded, so as a row of the list it may do anything: rise and fall with slip, fall with temperature, keep
// states. Each value is checked against what the law declares; a law that breaks its word gives NaN, which fails the node.
#pragma once

#include <limits>

#include "server/physics/interface/friction.hpp"
#include "server/physics/interface/friction_law.h"
#include "server/physics/interface/state_variable.hpp"

namespace shearbus::physics {

struct Own {
  static constexpr std::string_view kName = "own";
  static constexpr std::string_view kEquation = "the law's own";
  static constexpr std::string_view kAdds =
      "`\"own:NAME\"`, a law of a shared library that the server's administrator loads (friction_law.h)";
  static constexpr std::string_view kWhen = "friction that no law of the list has";
  static constexpr bool kRisesWithSlip = true;
  static constexpr bool kFallsWithSlip = true;
  static constexpr bool kDependsOnTemperature = true;
  static constexpr StateVariable kStates[] = {
      {"own_state_1", "1"}, {"own_state_2", "1"}, {"own_state_3", "1"}, {"own_state_4", "1"}};

  // Half of Coulomb's law, for tests of everything that takes a law.
  static InterfaceOptions typical(InterfaceOptions options, const Material& soft);
  static LawFault fault_of(const InterfaceOptions& options, const Material& /*soft*/) {
    if (options.own == nullptr) return {"friction_law", "the law \"own:NAME\" has not been loaded"};
    return {};
  }
  static FrictionValue at(const InterfaceOptions& options, const Material& soft, const ContactPoint& point);
  // No bound is known; the searches of a law that falls with slip need none.
  static double steepest(const InterfaceOptions& /*options*/, const Material& /*soft*/, const ContactPoint& /*point*/,
                         double /*coldest*/, double /*hottest*/) {
    return std::numeric_limits<double>::infinity();
  }
  static bool vanishes_at_melting(const InterfaceOptions& options) { return options.own->falls_with_temperature != 0; }
  static void advance(const InterfaceOptions& options, const ContactPoint& point, double* state);
};
static_assert(std::size(Own::kStates) == SHEARBUS_FRICTION_LAW_STATES);

}  // namespace shearbus::physics
