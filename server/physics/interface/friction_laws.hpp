// The friction laws. The place of a law in this list is its value of FrictionLaw, and one less than its number in the
// scene's enum.
#pragma once

#include <span>

#include "server/physics/interface/coulomb.hpp"
#include "server/physics/interface/state_variable.hpp"
#include "server/physics/interface/thermal_softening.hpp"
#include "server/physics/interface/velocity_weakening.hpp"
#include "server/physics/material/law_list.hpp"

namespace shearbus::physics {

template <FrictionLawClass... Laws>
using FrictionLawList = LawList<FrictionLaw, Laws...>;

using FrictionLaws = FrictionLawList<ConstantFriction,   // one line per law
                                     VelocityWeakening,  //
                                     ThermalSoftening>;

inline FrictionLawProperties properties_of(FrictionLaw law) {
  return FrictionLaws::with(law, [](auto own) { return properties_of_law<typename decltype(own)::type>(); });
}

// The form of the friction coefficient under the law of the options.
inline FrictionForm form_of(const InterfaceOptions& options) {
  return FrictionLaws::with(options.friction_law, [&](auto own) -> FrictionForm {
    using Law = typename decltype(own)::type;
    if constexpr (HasFrictionForm<Law>) {
      return Law::form(options);
    } else {
      return NoForm{};
    }
  });
}

// The states that a law declares as `static constexpr StateVariable kStates[]`; empty without that member.
inline std::span<const StateVariable> states_of(FrictionLaw law) {
  return FrictionLaws::with(law, [](auto own) -> std::span<const StateVariable> {
    using Law = typename decltype(own)::type;
    if constexpr (requires { Law::kStates; }) {
      return Law::kStates;
    } else {
      return {};
    }
  });
}

}  // namespace shearbus::physics
