// What the study of precision prints and writes.
#include "tests/study/report.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <string>

#include "shearbus_places.hpp"
#include "tests/study/precision.hpp"

namespace shearbus::study {
namespace {

std::string processor() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown";
}

std::string commit() {
  std::string text;
  if (FILE* pipe = ::popen("git -C \"" SHEARBUS_SOURCE_DIR "\" describe --always --dirty 2>/dev/null", "r")) {
    char line[128];
    if (std::fgets(line, sizeof line, pipe) != nullptr) text = line;
    ::pclose(pipe);
  }
  while (!text.empty() && text.back() == '\n') text.pop_back();
  return text.empty() ? "unknown" : text;
}

}  // namespace

std::string number(double value) {
  return std::isfinite(value) ? fmt::format("{:.6g}", value) : std::string("null");
}

std::string provenance(std::string_view study) {
  return fmt::format(
      "\"study\": \"{}\", \"version\": \"{}\", \"commit\": \"{}\", \"date\": \"{:%Y-%m-%d}\", \"processor\": \"{}\"",
      study, SHEARBUS_VERSION, commit(), fmt::gmtime(std::time(nullptr)), processor());
}

std::string table(const Result& result) {
  std::string text = fmt::format("\n{}\n  reference: {} (T0 to {:.1e} of what it has to melting)\n",
                                 result.problem->title, result.reference.method, result.reference.uncertainty);
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
        one->temperature_error < 100.0 * result.reference.uncertainty ? "  (near the reference's own)" : "");
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
  const Outcome* paper = nullptr;  // h/500, backward Euler, 1 ns
  for (const Outcome& one : result.outcomes)
    if (one.setting.cells == 500 && !one.setting.sdirk2 && one.setting.steps == 1000) paper = &one;
  for (const double tolerance : {1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6}) {
    const Outcome* best = cheapest(result, tolerance);
    if (best == nullptr) {
      text += fmt::format("    {:.0e}  none of the settings\n", tolerance);
    } else {
      text += fmt::format("    {:.0e}  {} ({:.0f} ns a run, error {:.1e})\n", tolerance, best->setting.text(),
                          best->ns_per_node, best->temperature_error);
    }
  }
  if (paper != nullptr) {
    const Outcome* best = cheapest(result, paper->temperature_error);
    text += fmt::format(
        "    the paper's grid, backward Euler, 1000 steps: error {:.1e}, {:.0f} ns; as accurate {:.1f} times "
        "cheaper: {}\n",
        paper->temperature_error, paper->ns_per_node, paper->ns_per_node / best->ns_per_node, best->setting.text());
  }
  return text;
}

std::string json(const std::vector<Result>& results, int repeats) {
  std::string text = fmt::format("{{\n  {}, \"repeats\": {},\n  \"problems\": [", provenance("precision"), repeats);
  for (const Result& result : results) {
    text += fmt::format(
        "{}\n    {{\"name\": \"{}\", \"title\": \"{}\", \"reference\": \"{}\", \"uncertainty\": {}, \"runs\": [",
        &result == &results.front() ? "" : ",", result.problem->name, result.problem->title, result.reference.method,
        number(result.reference.uncertainty));
    for (const Outcome& one : result.outcomes) {
      text += fmt::format(
          "{}\n      {{\"cells\": {}, \"grading\": {}, \"integrator\": \"{}\", \"modes_accuracy\": {}, \"steps\": {}, "
          "\"temperature_error\": {}, \"impulse_error\": {}, \"work_error\": {}, \"ns_per_node_step\": {}, "
          "\"ns_per_node\": "
          "{}, \"message_ns_per_node_step\": {}, \"heat_rows_per_step\": {}, \"state_bytes\": {}, "
          "\"first_order_share\": {}, "
          "\"divided_share\": {}, \"efficient\": {}, \"failure\": \"{}\"}}",
          &one == &result.outcomes.front() ? "" : ",", one.setting.cells, one.setting.grading,
          one.setting.sdirk2 ? "sdirk2" : "backward_euler", number(one.setting.accuracy), one.setting.steps,
          number(one.temperature_error), number(one.impulse_error), number(one.work_error),
          number(one.ns_per_node_step), number(one.ns_per_node), number(one.message_ns), number(one.solves_per_step),
          one.state_bytes, number(one.first_order_share), number(one.divided_share), one.efficient, one.failure);
    }
    text += "]}";
  }
  return text + "]\n}\n";
}

}  // namespace shearbus::study
