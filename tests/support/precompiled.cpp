// Carries the precompiled header of the test programs.
#include "tests/support/precompiled.hpp"
