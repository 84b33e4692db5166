// The friction laws. The place of a law in this list is its value of FrictionLaw, and one less than its number in the
// scene's enum.
#pragma once

#include <iterator>
#include <span>

#include "server/physics/interface/coulomb.hpp"
#include "server/physics/interface/own.hpp"
#include "server/physics/interface/prakash_clifton.hpp"
#include "server/physics/interface/rate_and_state.hpp"
#include "server/physics/interface/state_variable.hpp"
#include "server/physics/interface/thermal_softening.hpp"
#include "server/physics/interface/velocity_weakening.hpp"
#include "server/physics/material/law_list.hpp"

namespace shearbus::physics {

template <FrictionLawClass... Laws>
using FrictionLawList = LawList<FrictionLaw, Laws...>;

using FrictionLaws = FrictionLawList<ConstantFriction,   // one line per law
                                     VelocityWeakening,  //
                                     ThermalSoftening,   //
                                     PrakashClifton,     //
                                     RateAndState,       //
                                     Own>;

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
    if constexpr (FrictionWithState<Law>) {
      static_assert(std::size(Law::kStates) <= kMostFrictionStates);
      return Law::kStates;
    } else {
      return {};
    }
  });
}

}  // namespace shearbus::physics
