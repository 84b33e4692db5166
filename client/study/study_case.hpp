// The fixed problems of the studies. Each has a scene, a host that gives the inputs, and a reference solution.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "proto/scene/scene.hpp"
#include "server/physics/solver/model.hpp"

namespace shearbus::study {

// Results of a run: the interface temperature T0 at some times, and sums over all steps.
struct Answer {
  std::vector<double> time;         // times of the samples  [s]
  std::vector<double> temperature;  // interface temperature T0 at the times of `time`  [K]
  double impulse = 0.0;             // sum of |s| dt over the steps  [Pa s]
  double work = 0.0;                // friction work  [J/m2]
};

// A host that drives a layer. load() sets the same inputs in every lane of a tile, computed from the answers so far;
// take() receives the next answer.
class Host {
 public:
  virtual ~Host() = default;
  virtual void load(double time, double dt, physics::TileInputs& inputs) = 0;
  virtual void take(const physics::TileOutputs& outputs) = 0;
};

struct Reference {
  std::function<double(double)> temperature;  // T0 at a time
  double impulse = 0.0;
  double work = 0.0;
  // Error of the reference T0, relative to T_melt minus the initial temperature: that of its grid, that of its steps,
  // and both together.
  double space_error = 0.0, time_error = 0.0, uncertainty = 0.0;
  std::string method;
};

struct StudyCase {
  std::string name;
  std::string title;
  v1::Scene scene;  // scene of the problem; a study replaces the grid and the methods of the layer
  double end;       // duration of the run  [s]
  std::unique_ptr<Host> (*host)(const StudyCase&);
  Reference (*exact)(const StudyCase&) = nullptr;  // null: no exact solution, the caller must compute a reference
  double velocity_jump = 100.0;                    // initial or imposed jump  [m/s]
  double pressure = 11.2e9;                        // compression of the contact [Pa]
  double mass = 1.0;                               // mass per area of each body  [kg/m2]
  bool coupled = false;  // true if the inputs of a step depend on the answers of earlier steps
};

inline constexpr int kSamples = 10;  // number of samples of T0 in a run, at equal intervals

std::vector<StudyCase> fixed_cases();
StudyCase case_of(const v1::Scene& scene, double velocity_jump, double pressure, double mass, double end);

}  // namespace shearbus::study
