// The stability campaign: each row takes one quantity to its extremes and runs on every physics of the solvers; every
// step is checked against the invariants of tests/support/invariants.hpp. Rows and physics are tables, shared by
// shearbus-study and the tests of the label "stability".
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tests/support/invariants.hpp"

namespace shearbus::study::stability {

using testing::Figures;
using testing::kLanes;
using testing::ModelOptions;
using testing::Rig;
using testing::SearchEffort;

// The host before a row changes it: the paper's host, unless a scene describes another.
struct Host {
  double pressure = 11.2e9;        // [Pa]
  double half_zone_soft = 2.5e-6;  // half a zone at the interface, which sets the mass of (61)  [m]
  double half_zone_hard = 2.5e-6;  // [m]
  double dt = 1e-9;                // [s]
};

// A combination of scene options, and a host.
struct Physics {
  std::string name;
  ModelOptions options;
  Host host = {};
};
std::vector<Physics> all_physics();

// A force-driven step with several solutions: stick, and two different slips (MODEL.md, "Force-driven step").
struct SeveralAnswers {
  double dt;           // [s]
  double temperature;  // T_melt - below  [K]
  double below;        // [K]
  double slip;         // [v] without friction      [m/s]
};
// Finds such a step near melting, of the host's step length or longer; returns nothing if there is none up to 10 us.
std::optional<SeveralAnswers> several_answers(const Physics& physics);

// The course of one scene of a row. Before the first step all inputs have the host's values.
struct Course {
  Course(Rig& on, const Host& of, int scene_number);

  Rig& rig;
  const Host& host;
  testing::Draw draw;
  int scene;  // index among the scenes of the row
  int step = 0;
  double dt;                              // [s]
  std::optional<SeveralAnswers> several;  // set for the row of several answers

  bool forced() const;
  void impose(int lane, double jump);  // with two components: along a slowly turning direction of the lane
  void impose_all(const std::array<double, kLanes>& jumps);
  void push(int lane, double soft, double hard);  // sets the far stresses, in the same direction
  void go_on(int lane);                           // force-driven: sets the jump to the final jump of the last step
};

struct Row {
  std::string name;
  std::string what;
  int steps;
  // Makes the scenes of the row for a physics; none if the row does not apply to it.
  std::function<std::vector<ModelOptions>(const Physics&)> scenes;
  std::function<void(Course&)> start;        // called once, before the first step; may be empty
  std::function<void(Course&)> before_step;  // sets inputs and dt
  bool steady;  // constant inputs, under which an alternating answer is an error of the solver
  // Checks that the row has reached the regime it is meant for; returns the reason if not. May be empty.
  std::function<std::string(const Figures&)> missed;
};
std::vector<Row> all_rows();

// Not met: all invariants held, but the row did not reach the regime for which it is meant.
enum class Verdict { kHeld, kNotMet, kBroken, kNotAsked };

// The result of a row on a physics.
struct Outcome {
  Verdict verdict = Verdict::kNotAsked;
  std::string reason;  // of a broken row the invariant and the place, of a row not met the reason
  Figures figures;
  SearchEffort most;         // largest effort of one step of eight lanes
  double bound_share = 0.0;  // largest heat, relative to the heat of a molten interface
  double seconds = 0.0;
};
Outcome run(const Row& row, const Physics& physics, int most_steps = std::numeric_limits<int>::max());

// Returns the upper bound of the effort of one step of eight lanes. A larger effort shows that a search degenerates to
// bisection.
SearchEffort effort_bound(const ModelOptions& options, bool divided);
void require_effort(const SearchEffort& step, const Rig& rig);
void take_most(SearchEffort& most, const SearchEffort& step);

// Detects a value that alternates: many reversals in a row, of which none is much smaller than the reversal before.
class Ringing {
 public:
  // `size` is the scale of the value.
  void see(double value, double size);
  bool rings() const { return turns_ >= kTurns; }

 private:
  static constexpr int kTurns = 12;
  static constexpr double kUndamped = 0.5;
  static constexpr double kFelt = 1e-3;
  double last_ = 0.0, change_ = 0.0;
  int seen_ = 0, turns_ = 0;
};

// Heat of a layer whose interface is at melting from the first step on. By a comparison principle no other history of
// the same steps has more heat, so this bounds the friction work of all histories.
class MoltenLayer {
 public:
  explicit MoltenLayer(const Rig& rig);
  void step(const Rig& rig);  // uses the operators and pressures of the rig's last step
  double heat(int lane) const { return taken_[static_cast<std::size_t>(lane)]; }  // [J/m2]

 private:
  template <class Operator>
  void step_with(const Operator& heat, const Rig& rig);

  std::vector<double> rows_;              // temperatures of the conducting bodies, or modes
  std::array<double, kLanes> melting_{};  // highest melting temperature of the history  [K]
  std::array<double, kLanes> taken_{};    // [J/m2]
};

}  // namespace shearbus::study::stability
