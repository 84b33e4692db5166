// Coulomb's law with a constant coefficient: DLP (65).
#pragma once

#include "server/physics/interface/friction.hpp"

namespace shearbus::physics {

struct ConstantFriction {
  static constexpr std::string_view kName = "constant";
  static constexpr std::string_view kEquation = "DLP (65)";
  static constexpr std::string_view kAdds = "mu P, one coefficient";
  static constexpr std::string_view kWhen = "the default";
  static constexpr bool kRisesWithSlip = false;
  static constexpr bool kFallsWithSlip = false;
  static constexpr bool kDependsOnTemperature = false;

  static InterfaceOptions typical(const InterfaceOptions& options, const Material& /*soft*/) { return options; }
  static LawFault fault_of(const InterfaceOptions& /*options*/, const Material& /*soft*/) { return {}; }
  static FrictionValue at(const InterfaceOptions& options, const Material& /*soft*/, const ContactPoint& point) {
    return {options.friction_coefficient * point.pressure};
  }
  static FrictionForm form(const InterfaceOptions& options) {
    return ConstantCoefficient{options.friction_coefficient};
  }
};

}  // namespace shearbus::physics
