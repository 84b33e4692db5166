// Interface laws for which the shear column has exact solutions. Tests of the mesh use them in place of the subgrid
// model.
#pragma once

#include <limits>

#include "hydro_stub/problem.hpp"
#include "hydro_stub/simple_laws.hpp"

namespace shearbus::test {

using hydro::ConstantFrictionLaw;
inline constexpr double kFreeSlip = 0.0;
inline constexpr double kBonded = std::numeric_limits<double>::infinity();

// Makes a shear column of aluminium on steel with the elastic constants of the DLP paper
// (server/physics/material/catalog.cpp). The step length is `courant` times the time in which an elastic wave crosses a
// zone.
inline hydro::ColumnProblem aluminium_on_steel(std::vector<double> jumps, std::size_t zones, double length = 2e-3,
                                               double courant = 1.0) {
  hydro::ColumnProblem problem;
  problem.name = "aluminium_on_steel";
  problem.columns = jumps.size();
  problem.soft = {.columns = jumps.size(),
                  .zones = zones,
                  .zone_width = length / static_cast<double>(zones),
                  .density = 2703.0,
                  .shear_modulus = 27.6e9};
  problem.hard = {.columns = jumps.size(), .zones = zones, .density = 7900.0, .shear_modulus = 77e9};
  problem.hard.zone_width = problem.soft.transit_time() * problem.hard.wave_speed();
  problem.dt = courant * problem.soft.transit_time();
  problem.initial_temperature.assign(jumps.size(), 300.0);
  problem.pressure = hydro::PressureHistory{{}, std::vector<double>(jumps.size(), 11.2e9)};
  problem.initial_jump = std::move(jumps);
  return problem;
}

}  // namespace shearbus::test
