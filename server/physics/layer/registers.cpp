#include "server/physics/layer/registers.hpp"

namespace shearbus::physics {

bool machine_has_registers_of_four() {
#if SHEARBUS_REGISTERS_OF_FOUR
  return __builtin_cpu_supports("avx2") != 0;
#else
  return false;
#endif
}

bool registers_of_four = machine_has_registers_of_four();

}  // namespace shearbus::physics
