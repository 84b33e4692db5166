// The flow laws of this test program: those of the server and Bingham's law. The include path finds this file before
// the server's file of the same name, so the solver is compiled with the longer list, without a change of the server.
#include "server/physics/material/johnson_cook.hpp"
#include "server/physics/material/preston_tonks_wallace.hpp"
#include "server/physics/material/steinberg_cochran_guinan.hpp"
#include "tests/own_law/bingham.hpp"

using FlowLaws = FlowLawList<SteinbergCochranGuinan,  //
                             JohnsonCook,             //
                             PrestonTonksWallace,     //
                             Bingham>;
