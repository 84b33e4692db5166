// Tables and JSON of the work-precision study.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "client/study/precision.hpp"

namespace shearbus::study {

std::string table(const Result& result) {
  const Reference& reference = result.reference;
  std::string text = fmt::format(
      "\n{}\n  reference: {}\n  its T0 is known to {:.1e} of what it has to melting: {:.1e} in space, {:.1e} in time\n",
      result.study_case->title, reference.method, reference.uncertainty, reference.space_error, reference.time_error);
  text +=
      fmt::format("  {:<44} {:>9} {:>9} {:>9} {:>9} {:>9} {:>10} {:>7} {:>6}\n", "efficient settings, cheapest first",
                  "T0 error", "impulse", "work", "ns/step", "+ message", "ns/run", "rows", "bytes");
  std::vector<const Outcome*> front;
  for (const Outcome& one : result.outcomes)
    if (one.efficient) front.push_back(&one);
  std::sort(front.begin(), front.end(), [](auto* a, auto* b) { return a->ns_per_node < b->ns_per_node; });
  for (const Outcome* one : front) {
    text += fmt::format(
        "  {:<44} {:9.1e} {:9.1e} {:9.1e} {:9.0f} {:9.0f} {:10.0f} {:7.0f} {:6}{}\n", one->setting.text(),
        one->temperature_error, one->impulse_error, one->work_error, one->ns_per_node_step, one->message_ns,
        one->ns_per_node, one->solves_per_step, one->state_bytes,
        one->resolved ? "" : fmt::format("  (below {:.0e}, what the reference resolves)", one->known_error));
  }
  const auto failed = std::count_if(result.outcomes.begin(), result.outcomes.end(),
                                    [](const Outcome& one) { return !one.failure.empty(); });
  text += fmt::format("  {} settings, {} failed\n", result.outcomes.size(), failed);
  for (const Outcome& one : result.outcomes)
    if (!one.failure.empty()) text += fmt::format("  FAILED {}: {}\n", one.setting.text(), one.failure);
  return text;
}

std::string recommendation(const Result& result) {
  std::string text = "  cheapest for a tolerance of T0:\n";
  const Outcome* paper = nullptr;  // outcome of the paper's setting: 500 uniform cells, backward Euler, steps of 1 ns
  for (const Outcome& one : result.outcomes)
    if (one.setting.cells == 500 && !one.setting.sdirk2 && one.setting.steps == 1000) paper = &one;
  for (const double tolerance : {1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6}) {
    const Outcome* best = cheapest(result, tolerance);
    if (best == nullptr) {
      text += fmt::format("    {:.0e}  none of the settings\n", tolerance);
    } else {
      text += fmt::format("    {:.0e}  {} ({:.0f} ns a run, error {:.1e})\n", tolerance, best->setting.text(),
                          best->ns_per_node, best->known_error);
    }
  }
  if (paper != nullptr) {
    const Outcome* best = cheapest(result, paper->known_error);
    text += fmt::format(
        "    the paper's grid, backward Euler, 1000 steps: error {:.1e}, {:.0f} ns; as accurate {:.1f} times "
        "cheaper: {}\n",
        paper->temperature_error, paper->ns_per_node, paper->ns_per_node / best->ns_per_node, best->setting.text());
  }
  return text;
}

nlohmann::ordered_json json(const std::vector<Result>& results, int repeats) {
  nlohmann::ordered_json out = {{"repeats", repeats}};
  for (const Result& result : results) {
    nlohmann::ordered_json& entry = out["problems"].emplace_back();
    entry = {{"name", result.study_case->name},
             {"title", result.study_case->title},
             {"reference", result.reference.method},
             {"uncertainty", result.reference.uncertainty},
             {"space_error", result.reference.space_error},
             {"time_error", result.reference.time_error}};
    for (const Outcome& one : result.outcomes)
      entry["runs"].push_back({{"cells", one.setting.cells},
                               {"grading", one.setting.grading},
                               {"integrator", one.setting.sdirk2 ? "sdirk2" : "backward_euler"},
                               {"modes_accuracy", one.setting.accuracy},
                               {"steps", one.setting.steps},
                               {"temperature_error", one.temperature_error},
                               {"impulse_error", one.impulse_error},
                               {"work_error", one.work_error},
                               {"ns_per_node_step", one.ns_per_node_step},
                               {"ns_per_node", one.ns_per_node},
                               {"message_ns_per_node_step", one.message_ns},
                               {"heat_rows_per_step", one.solves_per_step},
                               {"state_bytes", one.state_bytes},
                               {"first_order_share", one.first_order_share},
                               {"divided_share", one.divided_share},
                               {"resolved", one.resolved},
                               {"efficient", one.efficient},
                               {"failure", one.failure}});
  }
  return out;
}

}  // namespace shearbus::study
