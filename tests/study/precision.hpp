// Error against run time (work-precision): every combination of grid, step length, time integrator and heat method on a
// fixed problem, with its error against a reference solution and its cost, and the efficient combinations.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tests/study/study_case.hpp"

namespace shearbus::study {

struct Setting {
  std::uint32_t cells = 0;  // 0: modes instead of a profile
  double grading = 1.0;
  bool sdirk2 = false;
  double accuracy = 0.0;  // accuracy of the modes, if cells is 0
  int steps = 0;
  double tolerance = 0.0;  // if positive, the server chooses everything except the steps

  std::string text() const;
};

// Errors and cost of a setting. The errors are NaN if the run failed.
struct Outcome {
  Setting setting;
  double temperature_error = 0.0;  // max |T0 - reference| / (T_melt - T_ref)
  double impulse_error = 0.0;      // relative
  double work_error = 0.0;         // relative
  double ns_per_node_step = 0.0;   // CPU time of the solver alone, median of the repeats
  double ns_per_node = 0.0;        // CPU time of the solver in the whole run
  double message_ns = 0.0;         // round trip without the solver, per node-step; 0: not measured
  double solves_per_step = 0.0;    // rows of heat updated in a step, summed over stages
  std::uint64_t state_bytes = 0;   // per node, committed and trial state
  double first_order_share = 0.0;  // share of the sdirk2 steps that fell back to backward Euler
  double divided_share = 0.0;      // share of the steps that were divided into substeps
  double estimate = 0.0;           // largest error estimate that was reported, for a setting with a tolerance
  std::string failure;             // empty: the run succeeded
  bool efficient = false;          // no cheaper setting is as accurate
};

struct Result {
  const StudyCase* study_case;
  Reference reference;
  std::vector<Outcome> outcomes;
};

struct SweepOptions {
  int repeats = 5;
  bool quick = false;  // few settings, for tests
};

v1::Scene scene_with(const StudyCase& study_case, const Setting& setting);
double melting_range(const StudyCase& study_case);  // T_melt - T_ref  [K]
std::function<double(double)> at_samples(const Answer& answer, double end);

Answer run(const StudyCase& study_case, const Setting& setting, Outcome* outcome, int repeats);
// Sets the errors of an answer against a reference; errors of impulse and work are relative.
void set_errors(const StudyCase& study_case, const Answer& answer, const Reference& reference, Outcome& outcome);
Reference reference_of(const StudyCase& study_case, bool quick);
Result sweep(const StudyCase& study_case, const SweepOptions& options);

// Returns the cheapest outcome with at most this error of T0, or null.
const Outcome* cheapest(const Result& result, double tolerance);

// Returns the cost of messages per node-step with the embedded server and 1,000 nodes  [ns].
double message_ns(const StudyCase& study_case, const Setting& setting);

std::string table(const Result& result);
std::string recommendation(const Result& result);
nlohmann::ordered_json json(const std::vector<Result>& results, int repeats);

}  // namespace shearbus::study
