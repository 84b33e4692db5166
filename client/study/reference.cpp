// Reference solutions of cases without an exact one. They are computed on grids that no setting of the study has, and
// their errors in space and in time are measured one by one.
#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "client/study/precision.hpp"
#include "server/service/scene_model.hpp"

namespace shearbus::study {
namespace {

// A way to solve a case finely.
struct Fine {
  int steps;
  bool sdirk2 = true;
  int cells = 0;          // 0: modes in place of a profile
  double growth = 1.0;    // width of the last cell over that of the first; 1: uniform cells
  double deeper = 1.0;    // depth of the layer over that of the case
  double accuracy = 0.0;  // largest relative error of the heat kernel, with modes
};

constexpr double kGrowth = 1e3;         // of the cells of a reference
constexpr double kOtherGrowth = 1e4;    // of the grid that measures the error in space where no uniform one can
constexpr double kDeeper = 5.0;         // of the profile that measures that of modes in a half-space
constexpr double kTail = 1.03;          // growth of the cells behind the layer of a half-space
constexpr double kFinestCell = 0.5e-9;  // width of uniform cells that resolve the flow next to melting  [m]
constexpr double kModes = 1e-9;

physics::ModelOptions options_of(const StudyCase& study_case, const Fine& fine) {
  // A scene refuses cells thinner than the distance of two atoms, which a reference may well have: they are set below.
  Setting setting{.sdirk2 = fine.sdirk2, .accuracy = fine.accuracy, .steps = fine.steps};
  if (fine.cells > 0) setting.cells = 60;
  physics::ModelOptions options = service::scene_model(scene_with(study_case, setting)).options;
  for (physics::GridOptions* grid : {&options.grid, options.hard_grid ? &*options.hard_grid : nullptr}) {
    if (grid == nullptr) continue;
    grid->thickness *= fine.deeper;
    if (fine.cells == 0) continue;
    grid->cells = fine.cells;
    grid->grading = fine.growth == 1.0 ? 1.0 : std::pow(fine.growth, 1.0 / fine.cells);
    grid->least_extension_grading = kTail;
  }
  return options;
}

// The lengths of the steps. A host that reacts to the answers has equal steps. Else half of the steps are in the first
// of the kSamples intervals, at quadratic times, so that neither the start, where T0 rises as sqrt(t), nor the onset of
// flow soon after it costs the order.
std::vector<double> step_lengths(const StudyCase& study_case, int steps) {
  if (study_case.coupled) return std::vector<double>(static_cast<std::size_t>(steps), study_case.end / steps);
  const double interval = study_case.end / kSamples;
  const int first = steps / 2, later = steps / 2 / (kSamples - 1);
  std::vector<double> lengths;
  lengths.reserve(static_cast<std::size_t>(steps));
  for (int i = 0; i < first; ++i) lengths.push_back(interval * (2.0 * i + 1.0) / first / first);
  lengths.insert(lengths.end(), std::size_t{kSamples - 1} * static_cast<std::size_t>(later), interval / later);
  return lengths;
}

Answer solve(const StudyCase& study_case, const Fine& fine) {
  testing::Rig rig(options_of(study_case, fine), 1);
  rig.inputs.wants_mean_stress = rig.model.options().strategy == physics::Strategy::kVelocityDriven;
  return run(study_case, rig, step_lengths(study_case, fine.steps));
}

Answer limit_in_space(const StudyCase& study_case, Fine fine) {
  Answer finest = solve(study_case, fine);
  if (fine.cells == 0) return finest;
  fine.cells /= 2;
  return limit(finest, solve(study_case, fine), 2);
}

Answer limit_in_time(const StudyCase& study_case, Fine fine) {
  const Answer finest = solve(study_case, fine);
  fine.steps /= 2;
  return limit(finest, solve(study_case, fine), fine.sdirk2 ? 2 : 1);
}

// The grids of a reference: `own`, and `other`, on which the error in space of `own` is measured.
struct Grids {
  Fine own, other;
  std::string text;
};

Grids grids_of(const StudyCase& study_case, bool quick) {
  const auto options = service::scene_model(study_case.scene).options;
  const int coarser = quick ? 8 : 1;
  if (allows(study_case, {.accuracy = kModes, .steps = 1000})) {
    const double deeper = options.grid.far_boundary == physics::FarBoundary::kHalfSpace ? kDeeper : 1.0;
    return {{.steps = 400'000 / coarser, .accuracy = kModes},
            {.steps = 40'000 / coarser, .cells = 1600 / coarser, .growth = kGrowth, .deeper = deeper},
            fmt::format("modes to {:.0e}, {} steps; in space against {} cells, in time against the other integrator",
                        kModes, 400'000 / coarser, 1600 / coarser)};
  }
  const int cells = (options.inertia ? 800 : 1600) / coarser;
  const int steps = (options.inertia ? 7200 : 28'800) / coarser;
  // A uniform grid shares nothing with the matched cells of graded grids.
  const int uniform = quick ? 8000 : 64'000;
  const bool resolves = !options.inertia && !options.hard_grid &&
                        options.grid.far_boundary != physics::FarBoundary::kHalfSpace &&
                        options.grid.thickness <= uniform * kFinestCell * coarser;
  Fine other{.steps = steps / 8, .cells = cells, .growth = kOtherGrowth};
  if (resolves) other = {.steps = 576, .cells = uniform};
  return {{.steps = steps, .cells = cells, .growth = kGrowth},
          other,
          fmt::format("{} cells that grow by {:.0f} in all, {} steps{}; in space against {}, in time against {}", cells,
                      kGrowth, steps, study_case.coupled ? "" : ", shorter at the start",
                      resolves ? fmt::format("{} uniform cells", uniform)
                               : fmt::format("cells that grow by {:.0f}", kOtherGrowth),
                      second_order(study_case) ? "the other integrator" : "half the steps")};
}

}  // namespace

bool second_order(const StudyCase& study_case) {
  return allows(study_case, {.cells = 60, .grading = 1.08, .sdirk2 = true, .steps = 1000});
}

// The limit in time is taken on the finer grid, and corrected in space by two grids at a fraction of the steps.
Reference by_extrapolation(const StudyCase& study_case, bool quick) {
  const bool sdirk2 = second_order(study_case);
  Grids grids = grids_of(study_case, quick);
  grids.own.sdirk2 = grids.other.sdirk2 = sdirk2;
  Fine at_few_steps = grids.own;
  at_few_steps.steps = grids.other.steps;
  const Answer few = solve(study_case, at_few_steps), in_space = limit_in_space(study_case, at_few_steps);
  const Answer in_time = limit_in_time(study_case, grids.own);
  Fine otherwise = grids.own;
  if (sdirk2)
    otherwise.sdirk2 = false;
  else
    otherwise.steps /= 2;
  const Answer best = combined(combined(in_time, 1.0, in_space, 1.0), 1.0, few, -1.0);
  Reference reference;
  reference.method = grids.text;
  const double range = melting_range(study_case);
  reference.space_error = apart(in_space, limit_in_space(study_case, grids.other)) / range;
  reference.time_error = apart(in_time, limit_in_time(study_case, otherwise)) / range;
  reference.uncertainty = reference.space_error + reference.time_error;
  reference.impulse = best.impulse;
  reference.work = best.work;
  reference.temperature = at_samples(best, study_case.end);
  return reference;
}

}  // namespace shearbus::study
