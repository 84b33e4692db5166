// The problem `shear_column` of a scene: two elastic half-spaces that slide on each other, in one dimension, for N
// independent columns at once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "hydro_stub/hydro.pb.h"
#include "hydro_stub/pressure_history.hpp"
#include "hydro_stub/shear_body.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::hydro {

struct ColumnProblem {
  std::string name;
  std::size_t columns = 1;
  physics::Material soft_material;
  physics::Material hard_material;
  BodyMesh soft;
  BodyMesh hard;
  bool yields = false;           // the soft body yields, and both bodies have temperatures (shear_bulk.hpp)
  bool law_has_layers = false;   // with `yields`: friction heat is the law's; otherwise the zones take it
  bool conducts_across = false;  // with `yields`: heat crosses the interface
  double dt = 0.0;               // step length  [s]
  std::string dt_reason;         // the condition that limits dt
  // number of steps; velocities belong to the half steps, so the first step, from t = 0 to dt/2, has half the length
  std::uint64_t steps = 0;
  // initial velocity of the soft body, per column; the hard body starts at rest  [m/s]
  std::vector<double> initial_jump;
  std::vector<double> initial_temperature;  // initial temperature of each column  [K]
  PressureHistory pressure;
};

// Refuses a scene: throws wire::Error{kInvalidScene} with the field at fault, the reason and the remedy.
[[noreturn]] void refuse(std::string field, std::string text, std::string remedy);

// Makes the material of a body, whose table in the scene is [table]. Throws for an unknown name and for inconsistent
// constants.
physics::Material resolve(const v1::Body& body, const std::string& table);

// Makes the problem `shear_column` of a scene. Throws wire::Error{kInvalidScene} that names the field at fault.
ColumnProblem make_problem(const guest::HydroScene& scene);

}  // namespace shearbus::hydro
