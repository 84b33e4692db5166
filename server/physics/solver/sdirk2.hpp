// SDIRK2 (Alexander 1977), the second-order step of the heat: two implicit stages at gamma dt and dt, L-stable, the
// last stage the answer. In increments,
//   T1 = T_old + gamma dt f(T1),   T = T_old + r (T1 - T_old) + gamma dt f(T),   r = (1 - gamma) / gamma
// so that each stage is a backward Euler step of gamma dt from a known temperature, with the root of the balance or of
// the interface law in it. It needs no slope from before the step, which a host's jump may have made stale.
#pragma once

namespace shearbus::physics::sdirk2 {

inline constexpr double kDiagonal = 0.29289321881345254;     // gamma = 1 - 1/sqrt(2)
inline constexpr double kExtrapolation = 2.414213562373095;  // r = 1 + sqrt(2)
inline constexpr double kFirstWeight = 1.0 - kDiagonal;      // of the first stage in the step's mean; kDiagonal: second

}  // namespace shearbus::physics::sdirk2
