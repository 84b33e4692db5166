// Error against run time (work-precision): every combination of grid, step length, time integrator and heat method on a
// fixed problem, its errors against a trusted reference and its cost, and which of them nothing beats.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tests/study/problem.hpp"

namespace shearbus::study {

struct Setting {
  std::uint32_t cells = 0;  // 0: no profile
  double grading = 1.0;
  bool sdirk2 = false;
  double accuracy = 0.0;  // of the modes, where there is no profile
  int steps = 0;
  double tolerance = 0.0;  // above 0: in place of all but the steps

  std::string text() const;
};

// A setting's errors and cost. Errors are NaN where it failed.
struct Outcome {
  Setting setting;
  double temperature_error = 0.0;  // max |T0 - reference| / (T_melt - T_ref)
  double impulse_error = 0.0;      // relative
  double work_error = 0.0;         // relative
  double ns_per_node_step = 0.0;   // solver alone, CPU time, median of the repeats
  double ns_per_node = 0.0;        // the whole run
  double message_ns = 0.0;         // per node-step, round trip less solver; 0: not measured
  double solves_per_step = 0.0;    // rows of heat updated in a step, stages included
  std::uint64_t state_bytes = 0;   // of a node, committed and trial
  double first_order_share = 0.0;  // of the steps of sdirk2: fell back to backward Euler
  double divided_share = 0.0;      // of the steps: cut into substeps
  double estimate = 0.0;           // largest that was told, of a setting with a tolerance
  std::string failure;             // empty: none
  bool efficient = false;          // nothing cheaper is as accurate
};

struct Result {
  const Problem* problem;
  Reference reference;
  std::vector<Outcome> outcomes;
};

struct SweepOptions {
  int repeats = 5;
  bool quick = false;  // few settings, for tests
};

wire::Scene scene_with(const Problem& problem, const Setting& setting);
double melting_range(const Problem& problem);  // T_melt - T_ref  [K]
std::function<double(double)> at_samples(const Answer& answer, double end);

Answer run(const Problem& problem, const Setting& setting, Outcome* outcome, int repeats);
// Errors of an answer against a reference; those of the impulse and the work are relative.
void set_errors(const Problem& problem, const Answer& answer, const Reference& reference, Outcome& outcome);
Reference reference_of(const Problem& problem, bool quick);
Result sweep(const Problem& problem, const SweepOptions& options);

// Cheapest outcome with at most this error of T0; null: none.
const Outcome* cheapest(const Result& result, double tolerance);

// What a message costs, per node-step, with the embedded server and 1,000 nodes.
double message_ns(const Problem& problem, const Setting& setting);

std::string table(const Result& result);
std::string recommendation(const Result& result);
nlohmann::ordered_json json(const std::vector<Result>& results, int repeats);

}  // namespace shearbus::study
