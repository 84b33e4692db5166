// SDIRK2 (Alexander 1977), the second-order time step of the heat equation dT/dt = f(T): two implicit stages at gamma
// dt and dt, L-stable; the last stage is the answer. In increments,
//   T1 = T_old + gamma dt f(T1),   T = T_old + r (T1 - T_old) + gamma dt f(T),   r = (1 - gamma) / gamma
// Each stage is thus a backward Euler step of gamma dt from a known temperature, in which the stress balance or the
// interface law is solved. The scheme needs no dT/dt from before the step, which would be wrong after a jump in the
// inputs of the host.
#pragma once

#include <cstddef>
#include <cstdint>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/solver/problem.hpp"

namespace shearbus::physics::sdirk2 {

inline constexpr double kDiagonal = 0.29289321881345254;     // coefficient gamma of SDIRK2, 1 - 1/sqrt(2)
inline constexpr double kExtrapolation = 2.414213562373095;  // factor of the extrapolation, r = (1 - gamma) / gamma
// Weight of stage 1 in the mean over a step; of stage 2: kDiagonal.
inline constexpr double kFirstWeight = 1.0 - kDiagonal;

// Computes for all lanes the temperatures of the second stage without the friction heat of this stage: extrapolates to
// T_old + r (T1 - T_old), then conducts. `T` holds T1 on entry and the result on return. With heat modes: conducts over
// the whole step from the old state and adds the response to `early_flux`, the heat flux of the first stage.
void begin_second_stage(const HeatOperator& stage, int num_rows, const double* T_old,
                        const double (&early_flux)[kLanes], double* T);
void begin_second_stage(const ModeOperator& step, int num_rows, const double* old, const double (&early_flux)[kLanes],
                        double* rows);

// Makes of the operator of the stages of a step of length dt that of the whole step with a constant flux: `heat` then has
// its length and its response.
void respond_to_constant_flux(HeatOperator& heat, double dt);

// Returns the active lanes in which begin_second_stage() gave a temperature of T_melt or above or one below the coldest
// temperature before the step. These lanes must take a backward Euler step, which without flux stays within the range
// of the old temperatures. A temperature that rounding alone puts below the coldest one is set to the coldest.
std::uint32_t lanes_out_of_range(const Problem& problem, const TileInputs& inputs, const double* T_old, double* T);

}  // namespace shearbus::physics::sdirk2
