#include "tests/study/tolerance.hpp"

#include <fmt/format.h>

#include <cmath>
#include <span>

#include "tests/study/report.hpp"

namespace shearbus::study {
namespace {

constexpr double kRequests[] = {1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6};
constexpr double kQuickRequests[] = {1e-2, 1e-4};
constexpr int kSteps[] = {10, 100, 1000};
constexpr int kQuickSteps[] = {20};

// A host that takes part in the answer makes an error of its own, which no layer can mend: there the layer is held
// against the strictest request in the same steps.
Reference strictest_in(const Problem& problem, int steps) {
  constexpr double strictest = kRequests[std::size(kRequests) - 1];
  const Answer best = run(problem, {.steps = steps, .tolerance = strictest}, nullptr, 1);
  Reference reference;
  reference.temperature = [best, end = problem.end](double t) {
    return best.temperature[static_cast<std::size_t>(std::lround(t / end * kSamples)) - 1];
  };
  reference.impulse = best.impulse;
  reference.work = best.work;
  reference.method = fmt::format("the same steps at {:.0e}", strictest);
  return reference;
}

}  // namespace

std::vector<Tracked> track_tolerances(const std::vector<Problem>& problems, const SweepOptions& options) {
  const auto requests = options.quick ? std::span<const double>(kQuickRequests) : std::span<const double>(kRequests);
  const auto steps = options.quick ? std::span<const int>(kQuickSteps) : std::span<const int>(kSteps);
  std::vector<Tracked> all;
  for (const Problem& problem : problems) {
    Reference reference = problem.coupled ? Reference{} : reference_of(problem, options.quick);
    all.push_back({.problem = problem.name, .reference = reference.method, .outcomes = {}});
    Tracked& tracked = all.back();
    for (const int count : steps) {
      if (problem.coupled) {
        reference = strictest_in(problem, count);
        tracked.reference = reference.method;
      }
      for (const double request : requests) {
        const Setting setting{.steps = count, .tolerance = request};
        Outcome outcome;
        set_errors(problem, run(problem, setting, &outcome, options.repeats), reference, outcome);
        tracked.outcomes.push_back(outcome);
      }
    }
  }
  return all;
}

std::string table(const std::vector<Tracked>& tracked) {
  std::string text;
  for (const Tracked& one : tracked) {
    text += fmt::format("\n{}\n  reference: {}\n  {:>8} {:>10} {:>10} {:>10} {:>9} {:>9} {:>9} {:>11} {:>6}\n",
                        one.problem, one.reference, "steps", "requested", "delivered", "of request", "estimate",
                        "impulse", "work", "ns/step", "bytes");
    for (const Outcome& found : one.outcomes) {
      text += fmt::format("  {:8} {:10.0e} {:10.1e} {:10.3f} {:9.1e} {:9.1e} {:9.1e} {:11.0f} {:6}{}\n",
                          found.setting.steps, found.setting.tolerance, found.temperature_error,
                          found.temperature_error / found.setting.tolerance, found.estimate, found.impulse_error,
                          found.work_error, found.ns_per_node_step, found.state_bytes,
                          found.failure.empty() ? "" : "  FAILED: " + found.failure);
    }
  }
  return text;
}

std::string json(const std::vector<Tracked>& tracked, int repeats) {
  std::string text = fmt::format("{{\n  {}, \"repeats\": {},\n  \"problems\": [", provenance("tolerance"), repeats);
  for (const Tracked& one : tracked) {
    text += fmt::format("{}\n    {{\"name\": \"{}\", \"reference\": \"{}\", \"runs\": [",
                        &one == &tracked.front() ? "" : ",", one.problem, one.reference);
    for (const Outcome& found : one.outcomes) {
      text += fmt::format(
          "{}\n      {{\"steps\": {}, \"requested\": {}, \"temperature_error\": {}, \"largest_estimate\": {}, "
          "\"impulse_error\": {}, \"work_error\": {}, \"ns_per_node_step\": {}, \"state_bytes\": {}, \"failure\": "
          "\"{}\"}}",
          &found == &one.outcomes.front() ? "" : ",", found.setting.steps, number(found.setting.tolerance),
          number(found.temperature_error), number(found.estimate), number(found.impulse_error),
          number(found.work_error), number(found.ns_per_node_step), found.state_bytes, found.failure);
    }
    text += "]}";
  }
  return text + "]\n}\n";
}

}  // namespace shearbus::study
