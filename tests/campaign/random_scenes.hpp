// Random scenes of the campaign: the options of tests/support/random_physics.hpp, and those that it does not draw.
#pragma once

#include "tests/support/random_physics.hpp"

namespace shearbus::study::stability {

// Draws further options for a scene and takes each that goes with the others: Simon's melting curve, isothermal far
// faces, and, in scenes that are not extreme, a tolerance. Sleep is drawn by tests/property/physics_sleep.cpp.
testing::ModelOptions with_further_options(testing::Draw& draw, testing::ModelOptions options, bool extreme);

// Draws the options of another pair of a scene, whose nodes have the same states: other constants of metals and
// interface, layers of another thickness. Half of the pairs differ in one constant alone, as nodes with parameters of
// their own do. Returns `first` itself if none is found.
testing::ModelOptions another_pair(testing::Draw& draw, const testing::ModelOptions& first);

}  // namespace shearbus::study::stability
