// Kernels whose register width is a type. A kernel is a header of function templates without an include guard; the file
// that defines SHEARBUS_KERNELS as its name and includes each_register.hpp compiles the kernel once per register width:
// in the namespace `two` for registers of two doubles, which every machine has, and in `four` for AVX2. Both compute
// every value by the same operations in the same order (contraction is off), so the bits are the same.
#pragma once

// clang has no push of a target for plain functions, and sanitizers need no speed: both use registers of two doubles.
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__)
#define SHEARBUS_REGISTERS_OF_FOUR 1
#else
#define SHEARBUS_REGISTERS_OF_FOUR 0
#endif

namespace shearbus::physics {

// Whether kernels use registers of four doubles: at first whether the machine has them. Tests switch between the two
// widths, when no step runs.
extern bool registers_of_four;
bool machine_has_registers_of_four();

}  // namespace shearbus::physics
