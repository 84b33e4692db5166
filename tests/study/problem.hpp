// The fixed problems of the study: what the host does, and what the answer is.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "proto/scene/scene.hpp"
#include "server/physics/solver/model.hpp"

namespace shearbus::study {

// T0 at some times, and what the host was given over the whole run.
struct Answer {
  std::vector<double> time;         // [s]
  std::vector<double> temperature;  // [K]
  double impulse = 0.0;             // sum of |s| dt  [Pa s]
  double work = 0.0;                // friction work  [J/m2]
};

// What the host sends in a step that starts at `time`, from what it was answered, for every lane of a tile the same.
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

struct Problem {
  std::string name;
  std::string title;
  v1::Scene scene;  // the layer's grid and methods are what is swept
  double end;       // [s]
  std::unique_ptr<Host> (*host)(const Problem&, double dt);
  Reference (*reference)(const Problem&);
  double velocity_jump = 100.0;  // [m/s]
  double pressure = 11.2e9;      // [Pa]
  double mass = 1.0;             // of each side  [kg/m2]
  bool coupled = false;          // the host takes part in the answer
};

inline constexpr int kSamples = 10;  // of T0 in a run: every tenth of it

std::vector<Problem> fixed_problems();
Problem problem_of(const v1::Scene& scene, double velocity_jump, double pressure, double mass, double end);

}  // namespace shearbus::study
