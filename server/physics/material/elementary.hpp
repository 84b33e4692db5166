// exp and log of one double, with the bits that they have in every lane of a register (layer/elementary.hpp). The C
// library picks variants with fused multiply-add where the processor has them, which changes last bits from host to
// host.
#pragma once

#include "server/physics/layer/registers.hpp"

namespace shearbus::physics {

// The functions exp(x) and exp(x) - 1, with x clamped to +-kExponentialRange.
inline double exponential(double x) {
  return exp_of(x);
}
inline double exponential_minus_1(double x) {
  return exp_minus_1_of(x);
}
// The natural logarithm of a positive normal number.
inline double logarithm(double x) {
  return log_of(x);
}
// The power x^y of a positive normal x.
inline double power(double x, double y) {
  return power_of(x, y);
}

}  // namespace shearbus::physics
