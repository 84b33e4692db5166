// A state variable that a law declares: one value per node, 0 at the start. The state list of the model
// (solver/states.hpp) adds a row for each, and checkpoints carry it under its name.
#pragma once

namespace shearbus::physics {

struct StateVariable {
  const char* name;  // for example "junction_strain"; a unit other than 1 is appended to the name
  const char* unit;  // unit in the notation of UDUNITS; "1": no dimension
};

}  // namespace shearbus::physics
