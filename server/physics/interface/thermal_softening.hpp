// Friction that softens with the temperature of the interface:
//
//   mu(T0) = mu (1 - T*^m),   T* = (T0 - T_ref) / (T_melt - T_ref), 0 below T_ref and 1 above T_melt
//
// This law is a modelling choice of this project, not of the paper: it applies the thermal factor of Johnson and Cook
// (1983) to the coefficient, so that friction vanishes where the soft body melts, as its yield limit does. T_melt is
// the melting temperature of the soft body at the pressure of the node. m is at least 1: with a smaller exponent the
// slope at T_ref is not bounded.
#pragma once

#include <algorithm>

#include "server/physics/interface/friction.hpp"
#include "server/physics/material/elementary.hpp"

namespace shearbus::physics {

struct ThermalSoftening {
  static constexpr std::string_view kName = "thermal_softening";
  static constexpr std::string_view kEquation = "mu (1 - T*^m)";
  static constexpr std::string_view kAdds = "friction that softens with the interface temperature, to 0 at melting";
  static constexpr std::string_view kWhen = "sliding that heats the interface far above T_ref before it yields";
  static constexpr bool kRisesWithSlip = false;
  static constexpr bool kFallsWithSlip = false;
  static constexpr bool kDependsOnTemperature = true;

  static InterfaceOptions typical(InterfaceOptions options, const Material& soft) {
    options.friction_reference_temperature = std::min(300.0, 0.5 * soft.melting_temperature);
    options.friction_softening_exponent = 2.0;
    return options;
  }

  static LawFault fault_of(const InterfaceOptions& options, const Material& soft) {
    if (!(options.friction_reference_temperature < soft.melting_temperature))
      return {"friction_reference_temperature_k", "it must be below the melting temperature of the soft body"};
    if (!(options.friction_softening_exponent >= 1.0))
      return {"friction_softening_exponent", "it must be at least 1: a smaller one has no bounded slope at T_ref"};
    return {};
  }

  static FrictionValue at(const InterfaceOptions& options, const Material& soft, const ContactPoint& point) {
    const double range = soft.melting_temperature - options.friction_reference_temperature;
    const double share = (point.temperature - options.friction_reference_temperature) / range;
    if (!(share < 1.0)) return {0.0};
    if (share <= kLeastShare) return {options.friction_coefficient * point.pressure};
    const double lost = power(share, options.friction_softening_exponent);
    return {
        options.friction_coefficient * (1.0 - lost) * point.pressure,
        -options.friction_coefficient * options.friction_softening_exponent * lost / (share * range) * point.pressure};
  }

  // An upper bound of |d friction / d T0|, the value at `hottest`: the slope rises with T0, since m >= 1.
  static double steepest(const InterfaceOptions& options, const Material& soft, const ContactPoint& point,
                         double coldest, double hottest) {
    const double range = soft.melting_temperature - options.friction_reference_temperature;
    const double share = std::clamp((hottest - options.friction_reference_temperature) / range, kLeastShare, 1.0);
    if (hottest <= options.friction_reference_temperature || coldest >= soft.melting_temperature) return 0.0;
    return options.friction_coefficient * options.friction_softening_exponent *
           power(share, options.friction_softening_exponent - 1.0) / range * point.pressure;
  }

  static FrictionForm form(const InterfaceOptions& options) {
    return FallsWithTemperature{options.friction_coefficient, options.friction_reference_temperature,
                                options.friction_softening_exponent};
  }

 private:
  static constexpr double kLeastShare = FallsWithTemperature::kLeastShare;
};

}  // namespace shearbus::physics
