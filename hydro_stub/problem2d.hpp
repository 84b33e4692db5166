// A two-dimensional problem of a scene, meshed and ready to run.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "hydro_stub/lagrange/cycle.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::hydro {

// What a run found beside what it should have.
struct Comparison {
  std::string what;
  std::string units;
  double exact;
  double found;
};

struct Problem2d {
  explicit Problem2d(lagrange::Bodies meshed) : bodies(std::move(meshed)) {}

  lagrange::Bodies bodies;
  std::string body_names;         // of the mesh's blocks, for people: "0 cone, 1 confinement, 2 flyer"
  std::vector<int> free_surface;  // nodes whose motion is recorded; may be empty
  double end_time = 0.0;          // [s]
  double history_interval = 0.0;  // [s]
  std::uint32_t frames = 1;       // fields, at equal times to the end
  physics::Material soft, hard;   // that slide on each other, if any do

  std::function<bool(const lagrange::Cycle&)> over;  // where given, may end the run before its time
  std::function<std::vector<Comparison>(const lagrange::Cycle&)> compare;  // where answers are known
};

// Nodes that ask the interface law.
std::size_t interface_nodes(const lagrange::Bodies& bodies);

}  // namespace shearbus::hydro
