// A two-dimensional problem of a scene, meshed and ready to run.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "hydro_stub/heat_bound.hpp"
#include "hydro_stub/lagrange/cycle.hpp"
#include "hydro_stub/shear_limits.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::hydro {

// A value that a run found, and the exact or published value it should have.
struct Comparison {
  std::string what;
  std::string units;
  double exact;
  double found;
};

// The strength of an interface and of the metal beside it (shear_limits.hpp).
struct InterfaceStrength {
  std::optional<double> cold;      // yield strength of the interface of a subgrid law when it is cold  [Pa]
  physics::AdiabaticPeak metal;    // largest flow stress of the soft metal
  double start_temperature = 0.0;  // of the metal  [K]
  bool flows_in_layer = false;  // the layer flows in addition to the slip, so that the answer hardly depends on zones
  bool too_strong() const { return cold && *cold > metal.stress; }
};

// The largest pressure and sliding velocity that an experiment's publication gives for the interface.
struct Envelope {
  double pressure;          // [Pa]
  double sliding_velocity;  // [m/s]
};

struct Problem2d {
  explicit Problem2d(lagrange::Bodies meshed) : bodies(std::move(meshed)) {}

  lagrange::Bodies bodies;
  std::string body_names;         // names of the mesh's blocks, for the summary: "0 cone, 1 confinement, 2 flyer"
  std::vector<int> free_surface;  // nodes whose motion is recorded; may be empty
  double end_time = 0.0;          // time at which the run ends, unless `over` ends it before  [s]
  double history_interval = 0.0;  // time between two rows of the recorded histories  [s]
  std::uint32_t frames = 1;       // number of field outputs, at equal intervals up to the end
  physics::Material soft, hard;   // metals on the two sides of the interface, if there is one

  std::vector<double> start_temperature;      // of each node's layer, where it is not that of the scene  [K]
  std::vector<double> layer_thickness;        // of each node's layer, where it is not that of the scene  [m]
  std::optional<HeatBound> heat_bound;        // absent where the interface law or the scene does not obey it
  std::optional<InterfaceStrength> strength;  // absent where the metals do not yield
  std::optional<Envelope> published;

  std::function<bool(const lagrange::Cycle&)> over;                        // if set, ends the run by returning true
  std::function<std::vector<Comparison>(const lagrange::Cycle&)> compare;  // if set, compares the run with known values
};

// Returns the number of nodes with an interface law.
std::size_t interface_nodes(const lagrange::Bodies& bodies);

}  // namespace shearbus::hydro
