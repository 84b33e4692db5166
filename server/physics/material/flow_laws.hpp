// The laws of the flow stress there are. A law's place in this list is its FlowLaw, and one less than its number in the
// scene's enum.
#pragma once

#include "server/physics/material/johnson_cook.hpp"
#include "server/physics/material/law_list.hpp"
#include "server/physics/material/steinberg_cochran_guinan.hpp"

namespace shearbus::physics {

using FlowLaws = LawList<FlowLaw,                 // one line each
                         SteinbergCochranGuinan,  //
                         JohnsonCook>;

}  // namespace shearbus::physics
