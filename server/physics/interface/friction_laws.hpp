// The friction laws. The place of a law in this list is its FrictionLaw, and one less than its number in the scene's
// enum.
#pragma once

#include "server/physics/interface/coulomb.hpp"
#include "server/physics/interface/thermal_softening.hpp"
#include "server/physics/interface/velocity_weakening.hpp"
#include "server/physics/material/law_list.hpp"

namespace shearbus::physics {

template <FrictionLawClass... Laws>
using FrictionLawList = LawList<FrictionLaw, Laws...>;

using FrictionLaws = FrictionLawList<ConstantFriction,   // one line each
                                     VelocityWeakening,  //
                                     ThermalSoftening>;

inline FrictionLawProperties properties_of(FrictionLaw law) {
  return FrictionLaws::with(law, [](auto own) { return properties_of_law<typename decltype(own)::type>(); });
}

}  // namespace shearbus::physics
