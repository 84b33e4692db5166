#include "client/study/option_rows.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "client/study/precision.hpp"
#include "tests/support/combinations.hpp"

namespace shearbus::study {
namespace {

using namespace testing;  // NOLINT(google-build-using-namespace): rigs and combinations of tests/support

constexpr double kEnd = 1e-6;
constexpr double kPressure = 11.2e9;
// The jump of either strategy, under which the interface comes to melting.
constexpr double kJump = 100.0, kForcedJump = 300.0;
constexpr int kCells = 30;
constexpr double kGrading = 1.25;
// The grids of references. They differ from each other and from the grid of the rows in the growth of all their cells.
constexpr double kGrowth = 1e4, kOtherGrowth = 1e3;
constexpr int kReferenceCells = 480, kReferenceSteps = 8000;
// Cells and steps of a layer with inertia, whose step costs a hundred times as much.
constexpr int kWaveCells = 240, kWaveSteps = 2000;

Answer solve(const ModelOptions& options, int steps) {
  Rig rig(options, 1);
  const double jump = options.strategy == Strategy::kForceDriven ? kForcedJump : kJump;
  const std::vector<double> lengths(static_cast<std::size_t>(steps), kEnd / steps);
  return run(case_of({}, jump, kPressure, 1.0, kEnd), rig, lengths);
}

ModelOptions with_cells(ModelOptions options, int cells, double grading) {
  if (options.modes) return options;
  const auto set = [&](GridOptions& grid) {
    grid.cells = cells;
    grid.grading = grading;
    grid.least_extension_grading = std::min(grading, grid.least_extension_grading);
  };
  set(options.grid);
  if (options.hard_grid) set(*options.hard_grid);
  return options;
}

// The row of options without a tolerance. All references are of backward Euler, which every option allows.
OptionRow row_of(const ModelOptions& given, bool quick) {
  ModelOptions options = given;
  options.time_integrator = TimeIntegrator::kBackwardEuler;
  if (options.modes)
    options.modes = {.accuracy = 1e-9, .shortest_step = 0.1 * kEnd / kReferenceSteps, .longest_time = kEnd};
  const int coarser = quick ? 4 : 1;
  const int cells = (options.inertia ? kWaveCells : kReferenceCells) / coarser;
  const int steps = (options.inertia ? kWaveSteps : kReferenceSteps) / coarser;
  const auto in_space = [&](double growth) {
    const auto at = [&](int n) { return solve(with_cells(options, n, std::pow(growth, 1.0 / n)), steps / 4); };
    const Answer fine = at(cells);
    return options.modes ? fine : limit(fine, at(cells / 2), 2);
  };
  const ModelOptions finest = with_cells(options, cells, std::pow(kGrowth, 1.0 / cells));
  const Answer whole = solve(finest, steps), half = solve(finest, steps / 2), quarter = solve(finest, steps / 4);
  const Answer in_time = limit(whole, half, 1), of_space = in_space(kGrowth);
  const Answer reference = combined(combined(in_time, 1.0, of_space, 1.0), 1.0, quarter, -1.0);

  const double range = at_pressure(options.soft, kPressure).melting_temperature - options.initial_temperature;
  OptionRow row;
  row.space_error = options.modes ? options.modes->accuracy : apart(of_space, in_space(kOtherGrowth)) / range;
  row.time_error = apart(in_time, limit(half, quarter, 1)) / range;
  for (const bool sdirk2 : {false, true}) {
    ModelOptions own = given;
    own.time_integrator = sdirk2 ? TimeIntegrator::kSdirk2 : TimeIntegrator::kBackwardEuler;
    if (own.modes) own.modes = {.accuracy = 1e-3, .shortest_step = 0.1 * kEnd / 1000, .longest_time = kEnd};
    if (!refusals(own).empty()) continue;
    for (const int count : {100, 1000}) {
      row.errors.push_back({sdirk2, count, apart(solve(own, count), reference) / range});
    }
  }
  return row;
}

}  // namespace

std::vector<OptionRow> option_rows(bool quick) {
  std::vector<OptionRow> rows;
  const std::vector<Item> all = items();
  for (const Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    const ModelOptions base = graded(paper_options(strategy), kCells, kGrading);
    const auto add = [&](const std::string& option, const std::string& companion, const ModelOptions& options) {
      OptionRow row = row_of(options, quick);
      row.option = option;
      row.companion = companion;
      row.strategy = strategy == Strategy::kVelocityDriven ? "velocity-driven" : "force-driven";
      rows.push_back(row);
    };
    add("", "", base);
    for (const Item& item : all) {
      const std::optional<WithItem> found = with_item(base, item, all);
      // A tolerance chooses cells and steps itself: shearbus-study tolerance holds it to what it promises.
      if (found && !found->with.tolerance) add(item.name, found->companion, found->with);
    }
  }
  return rows;
}

std::string table(const std::vector<OptionRow>& rows) {
  std::string text = fmt::format(
      "\noptions: error of T0 on {} cells x{}, by integrator and steps; * below ten times that of the reference\n"
      "  {:<16} {:<40} {:>9} {:>9}  {:>9} {:>9}  {:>9} {:>9}\n",
      kCells, kGrading, "strategy", "option", "space", "time", "euler 100", "1000", "sdirk2 100", "1000");
  for (const OptionRow& row : rows) {
    const std::string name = row.companion.empty() ? row.option : row.option + " with " + row.companion;
    text += fmt::format("  {:<16} {:<40} {:9.1e} {:9.1e}  ", row.strategy, name.empty() ? "none" : name,
                        row.space_error, row.time_error);
    for (const OptionError& one : row.errors)
      text += fmt::format("{:9.1e}{}", one.temperature_error,
                          one.temperature_error < 10.0 * (row.space_error + row.time_error) ? "*" : " ");
    text += '\n';
  }
  return text;
}

nlohmann::ordered_json json(const std::vector<OptionRow>& rows) {
  auto out = nlohmann::ordered_json::array();
  for (const OptionRow& row : rows) {
    nlohmann::ordered_json& entry = out.emplace_back();
    entry = {{"option", row.option},
             {"strategy", row.strategy},
             {"companion", row.companion},
             {"space_error", row.space_error},
             {"time_error", row.time_error}};
    for (const OptionError& one : row.errors)
      entry["runs"].push_back({{"integrator", one.sdirk2 ? "sdirk2" : "backward_euler"},
                               {"steps", one.steps},
                               {"temperature_error", one.temperature_error}});
  }
  return out;
}

}  // namespace shearbus::study
