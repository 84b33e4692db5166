// A state variable that a law declares: one value per node, 0 at the start. The model lists it among its states
// (solver/states.hpp), and checkpoints store it under its name.
#pragma once

namespace shearbus::physics {

struct StateVariable {
  const char* name;  // for example "junction_strain"; a unit other than 1 is appended to the name
  const char* unit;  // unit in the notation of UDUNITS; "1": no dimension
};

}  // namespace shearbus::physics
