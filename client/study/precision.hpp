// Work-precision study. Every combination of grid, step length, time integrator and heat method solves a problem. The
// study reports the error of each combination against a reference solution and its cost, and marks the efficient
// combinations.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "client/study/study_case.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::study {

struct Setting {
  std::uint32_t cells = 0;  // number of cells of the layer; 0: modes instead of a temperature profile
  double grading = 1.0;
  bool sdirk2 = false;
  double accuracy = 0.0;  // if cells is 0: largest accepted relative error of the heat kernel that the modes represent
  int steps = 0;
  // If positive, the tolerance of the scene: the server then chooses all settings except the number of steps.
  double tolerance = 0.0;

  std::string text() const;
};

// Errors and cost of a setting of the solver. If the run failed (`failure` is not empty) the errors mean nothing.
struct Outcome {
  Setting setting;
  double temperature_error = 0.0;  // largest |T0 - reference|, relative to T_melt minus the initial temperature
  double impulse_error = 0.0;      // relative error of the impulse, the sum of |s| dt
  double work_error = 0.0;         // relative error of the friction work
  double ns_per_node_step = 0.0;   // CPU time of the solver alone per node and step, median of the repeats
  double ns_per_node = 0.0;        // CPU time of the solver per node in the whole run
  double message_ns = 0.0;  // time of a message round trip without the solver, per node and step; 0: not measured
  // number of temperatures or modes that a node updates in a step, summed over the stages
  double solves_per_step = 0.0;
  std::uint64_t state_bytes = 0;   // bytes per node in a shard: committed and trial state, index and list entries
  double first_order_share = 0.0;  // share of the sdirk2 steps that fell back to backward Euler
  double divided_share = 0.0;      // share of the steps that were divided into substeps
  double estimate = 0.0;           // largest error estimate of a step, for a setting with a tolerance
  std::string failure;             // error message of a run that failed; empty: the run succeeded
  bool resolved = true;            // whether temperature_error is well above the error of the reference
  double known_error = 0.0;        // temperature_error, or the least error that the reference resolves
  bool efficient = false;          // true if no setting of at most the same cost has a smaller known error of T0
};

struct Result {
  const StudyCase* study_case;
  Reference reference;
  std::vector<Outcome> outcomes;
};

struct SweepOptions {
  int repeats = 5;
  bool quick = false;  // if true, the study runs few settings, for tests
};

v1::Scene scene_with(const StudyCase& study_case, const Setting& setting);
// Whether a server would accept the scene with this setting, and whether it would with sdirk2.
bool allows(const StudyCase& study_case, const Setting& setting);
bool second_order(const StudyCase& study_case);
// Returns the melting temperature at the pressure of the case, minus the initial temperature  [K].
double melting_range(const StudyCase& study_case);
std::function<double(double)> at_samples(const Answer& answer, double end);

// Runs the host of a case against the layer of a rig in steps of these lengths, and calls `watch`, if any, after each.
Answer run(const StudyCase& study_case, testing::Rig& rig, std::span<const double> lengths,
           const std::function<void(const physics::TileOutputs&)>& watch = {});
Answer run(const StudyCase& study_case, const Setting& setting, Outcome& outcome, int repeats);

// Linear combinations of the answers of two runs, and the largest difference of their temperatures [K].
Answer combined(const Answer& a, double wa, const Answer& b, double wb);
double apart(const Answer& a, const Answer& b);
// The limit for an error in proportion to the resolution to this power, from two resolutions of ratio 2.
Answer limit(const Answer& fine, const Answer& coarse, int order);

// Sets the errors of `outcome` from the differences between an answer and a reference.
void set_errors(const StudyCase& study_case, const Answer& answer, const Reference& reference, Outcome& outcome);
Reference by_extrapolation(const StudyCase& study_case, bool quick);  // for a case without an exact reference
Reference reference_of(const StudyCase& study_case, bool quick);
Result sweep(const StudyCase& study_case, const SweepOptions& options);

// Returns the cheapest outcome whose known_error is at most `tolerance`, or null if there is none.
const Outcome* cheapest(const Result& result, double tolerance);

// Returns the time [ns] of a message round trip without the solver, per node and step, measured with an embedded server
// and 1,000 nodes.
double message_ns(const StudyCase& study_case, const Setting& setting);

std::string table(const Result& result);
std::string recommendation(const Result& result);
nlohmann::ordered_json json(const std::vector<Result>& results, int repeats);

}  // namespace shearbus::study
