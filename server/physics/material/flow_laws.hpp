// The list of flow laws. The place of a law in the list, counted from 0, is its FlowLaw value. Its number in the enum
// FlowLaw of a scene is larger by 1.
#pragma once

#include <algorithm>

#include "server/physics/material/flow_law.hpp"
#include "server/physics/material/johnson_cook.hpp"
#include "server/physics/material/law_list.hpp"
#include "server/physics/material/preston_tonks_wallace.hpp"
#include "server/physics/material/steinberg_cochran_guinan.hpp"

namespace shearbus::physics {

template <FlowLawClass... Laws>
using FlowLawList = LawList<FlowLaw, Laws...>;

using FlowLaws = FlowLawList<SteinbergCochranGuinan,  // one line per law
                             JohnsonCook,             //
                             PrestonTonksWallace>;

// Whether the constant of Material belongs to this law.
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
