// The flow laws of this test program: those of the server and Bingham's law. The include path finds this file before
// the server's file of the same name, so the solver is compiled with the longer list, without a change of the server.
#pragma once

#include <algorithm>

#include "server/physics/material/flow_law.hpp"
#include "server/physics/material/johnson_cook.hpp"
#include "server/physics/material/law_list.hpp"
#include "server/physics/material/preston_tonks_wallace.hpp"
#include "server/physics/material/steinberg_cochran_guinan.hpp"
#include "tests/own_law/bingham.hpp"

namespace shearbus::physics {

template <FlowLawClass... Laws>
using FlowLawList = LawList<FlowLaw, Laws...>;

using FlowLaws = FlowLawList<SteinbergCochranGuinan,  //
                             JohnsonCook,             //
                             PrestonTonksWallace,     //
                             Bingham>;

inline bool has_constant(FlowLaw law, double Material::*constant) {
  return FlowLaws::with(law, [&](auto own) {
    const auto& constants = decltype(own)::type::kConstants;
    return std::find(constants.begin(), constants.end(), constant) != constants.end();
  });
}

inline FlowLawProperties properties_of(FlowLaw law) {
  return FlowLaws::with(law, [](auto own) { return properties_of_law<typename decltype(own)::type>(); });
}

}  // namespace shearbus::physics
