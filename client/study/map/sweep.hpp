// A sweep of constant pressures and velocity jumps through the velocity-driven model. Every pair of a pressure and a
// velocity jump is a node, and all nodes are one batch of a server inside this process.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "client/src/client.hpp"

namespace shearbus::map {

struct Axes {
  std::vector<double> pressure_pa;
  std::vector<double> velocity_m_per_s;

  std::size_t num_nodes() const { return pressure_pa.size() * velocity_m_per_s.size(); }
  std::size_t node(std::size_t pressure, std::size_t velocity) const {
    return pressure * velocity_m_per_s.size() + velocity;
  }
};

// Returns `count` values from `low` to `high`; neighbouring values have the same ratio.
std::vector<double> log_spaced(double low, double high, std::size_t count);

// The nodes of the map at one time of observation; each array has one value per node.
struct Observation {
  double time_s = 0.0;
  std::vector<double> shear_stress_pa;
  std::vector<double> slip_m;  // slip of each node since the start, the integral of its sliding velocity
  std::vector<double> interface_temperature_k;
  std::vector<std::uint8_t> regime;
};

struct Map {
  Axes axes;
  double dt_s = 0.0;
  std::vector<Observation> observations;
  std::vector<double> melting_time_s;  // end of the first step whose regime is melting; NaN: the node did not melt  [s]
  std::string scene_name;
  std::string effective_scene;  // the scene with all defaults filled in, as TOML
  std::string server_version;
  std::vector<std::string> warnings;
};

struct SceneText {
  std::string text;  // the scene of the map as TOML
  std::string file;  // name of the file that contains `text`, for error messages
};

// Steps all nodes of the map with the scene up to the last of the times `times_s`, and observes the nodes at each of
// these times. The times must be increasing multiples of dt_s. Throws Error if the layer of the scene does not carry
// the imposed jump, that is, unless drive is "layer_shear".
Map sweep(const SceneText& scene, const Axes& axes, const std::vector<double>& times_s, double dt_s);

}  // namespace shearbus::map
