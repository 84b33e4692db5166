#include "client/study/tolerance.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "server/service/scene_model.hpp"
#include "tests/support/fine_layer.hpp"

namespace shearbus::study {
namespace {

constexpr double kRequests[] = {1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6};
constexpr double kQuickRequests[] = {1e-2, 1e-4};
constexpr double kQuickHistoryRequests[] = {1e-1, 1e-2};  // references of smaller requests take long
constexpr int kSteps[] = {10, 100, 1000};
constexpr int kQuickSteps[] = {20};

// Resolution of a reference solution in time and space.
struct Fineness {
  int substeps;     // number of substeps in the whole run
  int cells;        // number of cells of each graded grid; not used by a model with modes
  double accuracy;  // largest relative error of the heat kernel of the modes; used only by a model with modes
};
constexpr Fineness kFineModes{100000, 0, 1e-9}, kFineCells{20000, 1000, 0.0};
constexpr int kQuickCoarser = 4;
constexpr double kFirstCells = 0.5e-9;  // a cell at depth z has a width of about (grading - 1) (z + kFirstCells)  [m]

Answer solve_finely(const StudyCase& study_case, int steps, const Fineness& fineness) {
  const double dt = study_case.end / steps;
  const int substeps = std::max(1, fineness.substeps / steps);
  physics::ModelOptions options = service::scene_model(study_case.scene).options;
  options.tolerance.reset();
  if (options.modes) {
    options.modes->accuracy = fineness.accuracy;
  } else {
    const double ratio = 1.0 + options.grid.thickness / kFirstCells;
    for (physics::GridOptions* grid : {&options.grid, options.hard_grid ? &*options.hard_grid : nullptr}) {
      if (grid == nullptr) continue;
      grid->cells = fineness.cells;
      grid->grading = std::pow(ratio, 1.0 / fineness.cells);
    }
  }
  test::FineLayer layer(options, dt / substeps);
  const auto host = study_case.host(study_case);
  Answer answer;
  for (int n = 0; n < steps; ++n) {
    physics::TileInputs inputs;
    inputs.active = (1u << physics::kLanes) - 1u;
    host->load(n * dt, dt, inputs);
    physics::TileOutputs step{};
    for (int j = 0; j < substeps; ++j) layer.advance(inputs, 1.0 / substeps, step);
    host->take(step);
    answer.impulse += std::abs(step.shear_stress[0]) * dt;
    answer.work += step.friction_heat[0] / layer.conducted_share();
    if ((n + 1) * kSamples % steps == 0) answer.temperature.push_back(step.interface_temperature[0]);
  }
  return answer;
}

// Computes a reference solution for runs with `steps` steps of the host: a layer with a finer grid and shorter
// substeps, driven by the same host in the same steps. The host's steps stay the same because a host that
// reacts to the answers has a time error of its own, which no layer can reduce. The uncertainty of the reference is its
// difference from a solution with half its resolution.
Reference solved_finely(const StudyCase& study_case, int steps, bool quick) {
  StudyCase strict = study_case;
  strict.scene = scene_with(study_case, {.tolerance = kRequests[std::size(kRequests) - 1]});
  const bool modes = service::scene_model(strict.scene).options.modes.has_value();
  const auto coarser = [&](int times) {
    const Fineness fine = modes ? kFineModes : kFineCells;
    return solve_finely(strict, steps, {fine.substeps / times, fine.cells / times, fine.accuracy * times});
  };
  const int times = quick ? kQuickCoarser : 1;
  const Answer best = coarser(times), other = coarser(2 * times);
  Reference reference{.temperature = at_samples(best, study_case.end), .impulse = best.impulse, .work = best.work};
  reference.uncertainty = apart(best, other) / melting_range(study_case);
  reference.method = fmt::format("{} in {} substeps{}; {:.0e} from half as many", modes ? "modes" : "cells",
                                 (modes ? kFineModes : kFineCells).substeps / times,
                                 study_case.coupled ? ", the same steps of the host" : "", reference.uncertainty);
  return reference;
}

// Each error of random histories with its name.
constexpr std::pair<const char*, double testing::TurningErrors::*> kHistoryErrors[] = {
    {"T0", &testing::TurningErrors::T0},
    {"impulse", &testing::TurningErrors::impulse},
    {"heat", &testing::TurningErrors::heat}};

}  // namespace

std::vector<Tracked> track_tolerances(const std::vector<StudyCase>& cases, const SweepOptions& options) {
  const auto requests = options.quick ? std::span<const double>(kQuickRequests) : std::span<const double>(kRequests);
  const auto steps = options.quick ? std::span<const int>(kQuickSteps) : std::span<const int>(kSteps);
  std::vector<Tracked> all;
  for (const StudyCase& study_case : cases) {
    const bool known = study_case.exact != nullptr && !study_case.coupled;
    Reference reference = known ? study_case.exact(study_case) : Reference{};
    Tracked& tracked =
        all.emplace_back(Tracked{.study_case = study_case.name, .reference = reference.method, .outcomes = {}});
    for (const int count : steps) {
      if (study_case.coupled || (!known && count == steps.front())) {
        reference = solved_finely(study_case, count, options.quick);
        tracked.reference = reference.method;
      }
      for (const double request : requests) {
        const Setting setting{.steps = count, .tolerance = request};
        Outcome outcome;
        set_errors(study_case, run(study_case, setting, outcome, options.repeats), reference, outcome);
        tracked.outcomes.push_back(outcome);
      }
    }
  }
  return all;
}

std::vector<testing::TurningAnswers> track_histories(unsigned seeds, bool quick) {
  const auto requests = quick ? std::span<const double>(kQuickHistoryRequests) : std::span<const double>(kRequests);
  return testing::run_turning_histories(seeds, {requests.begin(), requests.end()});
}

std::string table(const std::vector<Tracked>& tracked) {
  std::string text;
  for (const Tracked& one : tracked) {
    text += fmt::format("\n{}\n  reference: {}\n  {:>8} {:>10} {:>10} {:>10} {:>9} {:>9} {:>9} {:>11} {:>6}\n",
                        one.study_case, one.reference, "steps", "requested", "delivered", "of request", "estimate",
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

std::string table(const std::vector<testing::TurningAnswers>& histories) {
  if (histories.empty()) return {};
  std::string text = fmt::format(
      "\n{} random histories that turn while the pressure changes: error of request, median and largest\n"
      "  reference: the grid of {:.0e}; sums of the flow over the layer of a tile in a step of the host\n"
      "  {:>10} {:>8} {:>15}",
      histories.front().errors.size(), 0.1 * histories.back().request, "requested", "sums", "largest of all");
  for (const auto& [name, error] : kHistoryErrors) text += fmt::format(" {:>15}", name);
  text += '\n';
  for (const testing::TurningAnswers& one : histories) {
    const auto column = [](const std::pair<double, double>& found) {
      return fmt::format(" {:8.3f} {:6.3f}", found.first, found.second);
    };
    text += fmt::format("  {:10.0e} {:8.0f}{}", one.request, one.sums,
                        column(one.over_request(&testing::TurningErrors::largest)));
    for (const auto& [name, error] : kHistoryErrors) text += column(one.over_request(error));
    text += '\n';
  }
  return text;
}

nlohmann::ordered_json json(const std::vector<Tracked>& tracked, int repeats) {
  nlohmann::ordered_json out = {{"repeats", repeats}};
  for (const Tracked& one : tracked) {
    nlohmann::ordered_json& entry = out["problems"].emplace_back();
    entry = {{"name", one.study_case}, {"reference", one.reference}};
    for (const Outcome& found : one.outcomes)
      entry["runs"].push_back({{"steps", found.setting.steps},
                               {"requested", found.setting.tolerance},
                               {"temperature_error", found.temperature_error},
                               {"largest_estimate", found.estimate},
                               {"impulse_error", found.impulse_error},
                               {"work_error", found.work_error},
                               {"ns_per_node_step", found.ns_per_node_step},
                               {"state_bytes", found.state_bytes},
                               {"failure", found.failure}});
  }
  return out;
}

nlohmann::ordered_json json(const std::vector<testing::TurningAnswers>& histories) {
  nlohmann::ordered_json out = nlohmann::ordered_json::array();
  for (const testing::TurningAnswers& one : histories) {
    const auto [median, worst] = one.over_request(&testing::TurningErrors::largest);
    out.push_back({{"requested", one.request},
                   {"histories", one.errors.size()},
                   {"sums_per_step", one.sums},
                   {"median_of_request", median},
                   {"largest_of_request", worst}});
    for (const auto& [name, error] : kHistoryErrors) {
      const auto [of_median, of_worst] = one.over_request(error);
      out.back()["errors"][name] = {{"median_of_request", of_median}, {"largest_of_request", of_worst}};
    }
  }
  return out;
}

}  // namespace shearbus::study
