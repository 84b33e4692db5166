// The fixed problems of the studies: a scene, the inputs of a host and a reference solution.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "proto/scene/scene.hpp"
#include "server/physics/solver/model.hpp"

namespace shearbus::study {

// Results of a run: T0 at some times, and sums over all steps.
struct Answer {
  std::vector<double> time;         // [s]
  std::vector<double> temperature;  // [K]
  double impulse = 0.0;             // sum of |s| dt  [Pa s]
  double work = 0.0;                // friction work  [J/m2]
};

// A host that drives a layer: the same inputs for every lane of a tile, computed from the answers so far.
class Host {
 public:
  virtual ~Host() = default;
  virtual void load(double time, double dt, physics::TileInputs& inputs) = 0;
  virtual void take(const physics::TileOutputs& outputs) = 0;
};

struct Reference {
  std::function<double(double)> temperature;  // T0 at a time; none: made by extrapolation of the finest settings
  double impulse = 0.0;
  double work = 0.0;
  double uncertainty = 0.0;  // of T0, of what it has to melting
  std::string method;
};

struct StudyCase {
  std::string name;
  std::string title;
  v1::Scene scene;  // the layer's grid and methods are what is swept
  double end;       // [s]
  std::unique_ptr<Host> (*host)(const StudyCase&, double dt);
  Reference (*reference)(const StudyCase&);
  double velocity_jump = 100.0;  // [m/s]
  double pressure = 11.2e9;      // [Pa]
  double mass = 1.0;             // of each side  [kg/m2]
  bool coupled = false;          // the host takes part in the answer
};

inline constexpr int kSamples = 10;  // of T0 in a run: every tenth of it

std::vector<StudyCase> fixed_cases();
StudyCase case_of(const v1::Scene& scene, double velocity_jump, double pressure, double mass, double end);

}  // namespace shearbus::study
