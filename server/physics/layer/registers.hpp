// Kernels whose register width is a type. A kernel is a header of function templates without an include guard; the file
// that defines SHEARBUS_KERNELS as its name and includes each_register.hpp compiles the kernel once per register width:
// in the namespace `one` for one double, in `two` for registers of two doubles, which every machine has, and in `four`
// for AVX2. What a register of one double needs, plain numbers and masks, is in the inline namespace `point`, where the
// rest of the model finds it, too. All widths compute every value by the same operations in the same order (contraction
// is off), so the bits are the same.
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "server/physics/layer/lanes.hpp"

// clang has no push of a target for plain functions, and sanitizers need no speed: both use registers of two doubles.
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__)
#define SHEARBUS_REGISTERS_OF_FOUR 1
#else
#define SHEARBUS_REGISTERS_OF_FOUR 0
#endif

namespace shearbus::physics {

inline constexpr double kExponentialRange = 700.0;  // largest |x| that enters exp(x), so that exp(x) is a normal number

// Whether kernels use registers of four doubles: at first whether the machine has them. Tests switch between the two
// widths, when no step runs.
extern bool registers_of_four;
bool machine_has_registers_of_four();

inline namespace point {
#define SHEARBUS_WIDTH 1
#include "server/physics/layer/register.hpp"
#undef SHEARBUS_WIDTH
}  // namespace point

}  // namespace shearbus::physics
