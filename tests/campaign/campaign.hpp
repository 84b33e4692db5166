// The stability campaign is a table. A row takes one quantity to its extremes. A physics is a combination of scene
// options together with a host. Each row runs on each physics, and every step is checked against the invariants of
// tests/support/invariants.hpp. The program shearbus-study and the tests with the label "stability" use the same rows
// and physics.
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

// The inputs of the host before a row changes them. The defaults are those of the paper; a user's scene may give
// others.
struct Host {
  double pressure = 11.2e9;        // pressure on the interface  [Pa]
  double half_zone_soft = 2.5e-6;  // half the width of the soft zone; times the density, m_soft of DLP (61)  [m]
  double half_zone_hard = 2.5e-6;  // half the width of the hard zone  [m]
  double dt = 1e-9;                // step length  [s]
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
  double dt;           // step length  [s]
  double temperature;  // temperature before the step, below T_melt  [K]
  double below;        // distance of `temperature` from melting, T_melt - temperature  [K]
  double slip;         // slip velocity [v] that the step would have without friction  [m/s]
};
// Searches temperatures below melting for a force-driven step with several solutions. The step length grows from that
// of the host up to 10 us. Returns nothing if there is no such step.
std::optional<SeveralAnswers> several_answers(const Physics& physics);

// The run of one scene of a row (a load history of the campaign): the rig with the scene's model, the host and the
// current step. Before the first step all inputs are those of `host`.
struct Course {
  Course(Rig& on, const Host& of, int scene_number);

  Rig& rig;
  const Host& host;
  testing::Draw draw;
  int scene;  // index among the scenes of the row
  int step = 0;
  double dt;                              // length of the next step  [s]
  std::optional<SeveralAnswers> several;  // set only in the row "three_roots"

  bool forced() const;
  // Sets the velocity jump. With two components its direction turns slowly, and differs between lanes.
  void impose(int lane, double jump);
  void impose_all(const std::array<double, kLanes>& jumps);
  void push(int lane, double soft, double hard);  // sets both bodies' far stresses  [Pa], parallel to the velocity jump
  void go_on(int lane);                           // force-driven: sets the jump to the final jump of the last step
};

struct Row {
  std::string name;
  std::string what;
  int steps;
  // Makes the scenes that the row runs on a physics; none if the row does not apply to this physics.
  std::function<std::vector<ModelOptions>(const Physics&)> scenes;
  std::function<void(Course&)> start;        // called once, before the first step; may be empty
  std::function<void(Course&)> before_step;  // sets the inputs and the length of the next step
  bool steady;  // true: the inputs do not alternate, so an alternating answer is an error of the solver
  // Returns an empty text if the run has reached the regime for which the row is meant, otherwise what is missing. The
  // function may be absent.
  std::function<std::string(const Figures&)> missed;
};
std::vector<Row> all_rows();

// The verdict on a row that ran on a physics. kNotMet: all invariants held, but the row did not reach the regime for
// which it is meant. kNotAsked: the row does not apply to the physics.
enum class Verdict { kHeld, kNotMet, kBroken, kNotAsked };

// The result of running a row (a load history) on a physics (scene options and a host).
struct Outcome {
  Verdict verdict = Verdict::kNotAsked;
  std::string reason;  // kBroken: invariant, scene, step and lane; kNotMet: what is missing
  Figures figures;
  SearchEffort most;         // largest search effort in one step of eight lanes (nodes stepped together)
  double bound_share = 0.0;  // largest friction heat of a lane, relative to the bound that MoltenLayer gives
  double seconds = 0.0;
};
Outcome run(const Row& row, const Physics& physics, int most_steps = std::numeric_limits<int>::max());

// Returns the upper bound of the search effort in one step of eight lanes. A larger effort shows that a search for a
// root has degenerated to bisection.
SearchEffort effort_bound(const ModelOptions& options, bool divided);
void require_effort(const SearchEffort& step, const Rig& rig);
void take_most(SearchEffort& most, const SearchEffort& step);

// Detects a value that alternates from step to step: kTurns reversals in a row, none much smaller than the one before.
class Ringing {
 public:
  // Adds the next value; reversals that are small relative to `size` do not count.
  void see(double value, double size);
  bool rings() const { return turns_ >= kTurns; }

 private:
  static constexpr int kTurns = 12;
  static constexpr double kUndamped = 0.5;
  static constexpr double kFelt = 1e-3;
  double last_ = 0.0, change_ = 0.0;
  int seen_ = 0, turns_ = 0;
};

// A layer whose interface has the melting temperature from the first step on. By a comparison principle no other
// history with the same steps of backward Euler puts more heat into the layer, so heat() bounds the friction heat of
// every such history; for other integrators see share_of_first_step().
class MoltenLayer {
 public:
  explicit MoltenLayer(const Rig& rig);
  void step(const Rig& rig);  // repeats the rig's last step: same operators and pressures, molten interface
  // Returns the heat that entered the layer of a lane since the start  [J/m2].
  double heat(int lane) const { return taken_[static_cast<std::size_t>(lane)]; }

 private:
  template <class Operator>
  void step_with(const Operator& heat, const Rig& rig);

  std::vector<double> rows_;  // heat state of each lane: temperatures of all vertices, or heat modes instead
  std::array<double, kLanes> melting_{};  // highest melting temperature since the start  [K]
  std::array<double, kLanes> taken_{};    // friction heat that entered each lane since the start  [J/m2]
};

}  // namespace shearbus::study::stability
