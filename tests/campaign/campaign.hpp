// The stability campaign: rows that push one thing to its extreme, each run on every physics the solvers know, every
// step held to the invariants of tests/support/invariants.hpp. Rows and physics are tables, shared by shearbus-study
// and the tests of the label "stability".
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

// What a host is like before a row pushes it: the paper's, unless a scene says otherwise.
struct Host {
  double pressure = 11.2e9;        // [Pa]
  double half_zone_soft = 2.5e-6;  // of its mesh at the interface: the mass of (61)  [m]
  double half_zone_hard = 2.5e-6;  // [m]
  double dt = 1e-9;                // [s]
};

// A combination of the options of a scene, and its host.
struct Physics {
  std::string name;
  ModelOptions options;
  Host host = {};
};
std::vector<Physics> all_physics();

// Where a force-driven step has several answers: it sticks, or slips with either of two slips (MODEL.md section 6).
struct SeveralAnswers {
  double dt;           // [s]
  double temperature;  // below melting by `below`  [K]
  double below;        // [K]
  double slip;         // [v] without friction      [m/s]
};
// Near melting, at the host's step length or the next longer ones; none: there are no such steps up to 10 us.
std::optional<SeveralAnswers> several_answers(const Physics& physics);

// One scene of a row under way. Before the first step everything is as the host is.
struct Course {
  Course(Rig& on, const Host& of, int scene_number);

  Rig& rig;
  const Host& host;
  testing::Draw draw;
  int scene;  // of the row's
  int step = 0;
  double dt;                              // [s]
  std::optional<SeveralAnswers> several;  // of the row that asks for them

  bool forced() const;
  void impose(int lane, double jump);  // with two components along a direction of the lane's own that turns slowly
  void impose_all(const std::array<double, kLanes>& jumps);
  void push(int lane, double soft, double hard);  // far stresses, in the same direction
  void go_on(int lane);                            // force-driven: the jump the last step ended with
};

struct Row {
  std::string name;
  std::string what;
  int steps;
  // The scenes of the row made of a physics, which have its host; none: the row is not about it.
  std::function<std::vector<ModelOptions>(const Physics&)> scenes;
  std::function<void(Course&)> start;        // once, before the first step; may be empty
  std::function<void(Course&)> before_step;  // inputs and dt
  bool steady;                               // the inputs stay: an answer that alternates is the solver's own doing
  // What a row has to have met on a physics, or it tests less than it says: why it has not, or nothing. May be empty.
  std::function<std::string(const Figures&)> missed;
};
std::vector<Row> all_rows();

// Not met: all held, but the row did not come to what it is for.
enum class Verdict { kHeld, kNotMet, kBroken, kNotAsked };

// A row on a physics.
struct Outcome {
  Verdict verdict = Verdict::kNotAsked;
  std::string reason;  // broken: what, and where; not met: why
  Figures figures;
  SearchEffort most;         // in one step of eight lanes
  double bound_share = 0.0;  // of the heat a molten interface would have taken, at most
  double seconds = 0.0;
};
Outcome run(const Row& row, const Physics& physics, int most_steps = std::numeric_limits<int>::max());

// Most that one step of eight lanes may ask. More is a search that bisects where it should not have to.
SearchEffort effort_bound(const ModelOptions& options, bool divided);
void require_effort(const SearchEffort& step, const Rig& rig);
void take_most(SearchEffort& most, const SearchEffort& step);

// Whether a value alternates by itself: many turns in a row, none much smaller than the one before.
class Ringing {
 public:
  // `size`: what the value is to be measured by.
  void see(double value, double size);
  bool rings() const { return turns_ >= kTurns; }

 private:
  static constexpr int kTurns = 12;
  static constexpr double kUndamped = 0.5;
  static constexpr double kFelt = 1e-3;
  double last_ = 0.0, change_ = 0.0;
  int seen_ = 0, turns_ = 0;
};

// Heat that a layer takes whose interface is at melting from the first step on. By comparison no history of the same
// steps takes more: this bounds the friction work of all of them.
class MoltenLayer {
 public:
  explicit MoltenLayer(const Rig& rig);
  void step(const Rig& rig);  // with the operators and pressures of the rig's last step
  double heat(int lane) const { return taken_[static_cast<std::size_t>(lane)]; }  // [J/m2]

 private:
  template <class Operator>
  void step_with(const Operator& heat, const Rig& rig);

  std::vector<double> rows_;              // of all that conducts, or of the modes
  std::array<double, kLanes> melting_{};  // highest of the history  [K]
  std::array<double, kLanes> taken_{};    // [J/m2]
};

}  // namespace shearbus::study::stability
