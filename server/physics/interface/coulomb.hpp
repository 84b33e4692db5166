// Coulomb's law with a constant coefficient: DLP (65).
#pragma once

#include <string_view>

#include "server/physics/interface/friction.hpp"

namespace shearbus::physics {

struct ConstantFriction {
  static constexpr std::string_view kName = "constant";

  static Friction friction(const InterfaceOptions& law, double pressure, double /*c*/, double /*b*/,
                           double /*a_stick*/) {
    const double limit = law.friction_coefficient * pressure;
    return {limit, limit};
  }
};

}  // namespace shearbus::physics
