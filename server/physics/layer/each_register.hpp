// Compiles the kernels of the header SHEARBUS_KERNELS for each register width (registers.hpp).
#include "server/physics/layer/registers.hpp"

#ifndef SHEARBUS_KERNELS
#error "define SHEARBUS_KERNELS as the name of the header of the kernels"
#endif

#if defined(__clang__)
#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wbitwise-instead-of-logical"  // the masks of one lane are of type bool
#endif
#define SHEARBUS_WIDTH 1
namespace shearbus::physics::one {
#include "server/physics/layer/row.hpp"
#include SHEARBUS_KERNELS
}  // namespace shearbus::physics::one
#undef SHEARBUS_WIDTH
#if defined(__clang__)
#pragma clang diagnostic pop
#endif

#define SHEARBUS_WIDTH 2
namespace shearbus::physics::two {
#include "server/physics/layer/register.hpp"
#include "server/physics/layer/row.hpp"
#include SHEARBUS_KERNELS
}  // namespace shearbus::physics::two
#undef SHEARBUS_WIDTH

#if SHEARBUS_REGISTERS_OF_FOUR
#pragma GCC push_options
#pragma GCC target("avx2")
#define SHEARBUS_WIDTH 4
namespace shearbus::physics::four {
#include "server/physics/layer/register.hpp"
#include "server/physics/layer/row.hpp"
#include SHEARBUS_KERNELS
}  // namespace shearbus::physics::four
#undef SHEARBUS_WIDTH
#pragma GCC pop_options
#endif

// Calls the kernel `name` of the width in use.
#if SHEARBUS_REGISTERS_OF_FOUR
#define SHEARBUS_CALL(name, ...) (registers_of_four ? four::name(__VA_ARGS__) : two::name(__VA_ARGS__))
#else
#define SHEARBUS_CALL(name, ...) two::name(__VA_ARGS__)
#endif
