// The list of flow laws. The place of a law in the list, counted from 0, is its FlowLaw value. Its number in the enum
// FlowLaw of a scene is larger by 1. flow_laws.hpp includes this file for one double, and the kernels of solver/flow for
// registers; so it has no include guard.
#include "server/physics/material/johnson_cook.hpp"
#include "server/physics/material/preston_tonks_wallace.hpp"
#include "server/physics/material/steinberg_cochran_guinan.hpp"

using FlowLaws = FlowLawList<SteinbergCochranGuinan,  // one line per law
                             JohnsonCook,             //
                             PrestonTonksWallace>;
