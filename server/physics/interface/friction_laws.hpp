// The friction laws there are. A law's place in this list is its FrictionLaw, and one less than its number in the
// scene's enum.
#pragma once

#include "server/physics/interface/coulomb.hpp"
#include "server/physics/interface/velocity_weakening.hpp"
#include "server/physics/material/law_list.hpp"

namespace shearbus::physics {

using FrictionLaws = LawList<FrictionLaw,       // one line each
                             ConstantFriction,  //
                             VelocityWeakening>;

}  // namespace shearbus::physics
