// SHEARBUS_INDEPENDENT stands before a loop whose iterations share no memory that one of them writes. The compiler need
// not check at run time that arrays do not overlap, which it gives up for many arrays, and vectorises the loop.
#pragma once

#include "server/physics/layer/wide.hpp"

#if defined(__GNUC__) && !defined(__clang__)
#define SHEARBUS_INDEPENDENT _Pragma("GCC ivdep")
#else
#define SHEARBUS_INDEPENDENT
#endif
