// Forms of a friction coefficient that the kernels of the force-driven step evaluate in registers (METHODS.md,
// "Arithmetic"). A law whose coefficient has one of these forms declares it: `static FrictionForm form(options)`. The
// kernels know forms, not laws; the step of a law without a form is made lane by lane.
#pragma once

#include <variant>

namespace shearbus::physics {

struct ConstantCoefficient {
  double coefficient;
};

// mu(v) = fast + (at_rest - fast) exp(-decay v), with the slip velocity v
struct FallsWithSlip {
  double at_rest, fast;
  double decay;  // [s/m]
};

// mu(T0) = cold (1 - T*^exponent), T* = (T0 - reference) / (T_melt - reference), 0 below `reference`; exponent >= 1
struct FallsWithTemperature {
  double cold;
  double reference;  // [K]
  double exponent;

  static constexpr double kLeastShare = 1e-300;  // a smaller T* counts as 0: powers take normal numbers only
};

struct NoForm {};

using FrictionForm = std::variant<NoForm, ConstantCoefficient, FallsWithSlip, FallsWithTemperature>;

}  // namespace shearbus::physics
