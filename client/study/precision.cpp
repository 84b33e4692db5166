#include "client/study/precision.hpp"
#include "tests/support/scenes.hpp"

#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>
#include <stdexcept>

#include "client/src/client.hpp"
#include "server/embedded.hpp"
#include "server/physics/material/strength.hpp"
#include "server/service/scene_model.hpp"
#include "server/shard/shard.hpp"

namespace shearbus::study {

v1::Scene scene_with(const StudyCase& study_case, const Setting& setting) {
  v1::Scene scene = study_case.scene;
  if (setting.tolerance > 0.0) {
    v1::Layer& layer = *scene.mutable_layer();
    layer.clear_cells();
    layer.clear_grading();
    layer.clear_time_integrator();
    layer.clear_heat();
    layer.clear_modes();
    scene.set_tolerance(setting.tolerance);
    return scene;
  }
  scene.clear_tolerance();
  scene.mutable_layer()->set_time_integrator(setting.sdirk2 ? v1::TIME_INTEGRATOR_SDIRK2
                                                            : v1::TIME_INTEGRATOR_BACKWARD_EULER);
  if (setting.cells > 0) {
    scene.mutable_layer()->set_cells(setting.cells);
    scene.mutable_layer()->set_grading(setting.grading);
    scene.mutable_layer()->set_heat(v1::HEAT_PROFILE);
    scene.mutable_layer()->clear_modes();
  } else {
    scene.mutable_layer()->clear_cells();
    scene.mutable_layer()->clear_grading();
    scene.mutable_layer()->set_heat(v1::HEAT_MODES);
    scene.mutable_layer()->clear_modes();
    scene.mutable_layer()->mutable_modes()->set_accuracy(setting.accuracy);
    scene.mutable_layer()->mutable_modes()->set_shortest_step_s(0.4 * study_case.end / setting.steps);
    scene.mutable_layer()->mutable_modes()->set_longest_time_s(study_case.end);
  }
  return scene;
}

double melting_range(const StudyCase& study_case) {
  const auto options = service::scene_model(study_case.scene).options;
  return physics::at_pressure(options.soft, study_case.pressure).melting_temperature - options.initial_temperature;
}

std::function<double(double)> at_samples(const Answer& answer, double end) {
  return [T0 = answer.temperature, end](double t) {
    return T0[static_cast<std::size_t>(std::lround(t / end * kSamples)) - 1];
  };
}

bool allows(const StudyCase& study_case, const Setting& setting) {
  try {
    service::scene_model(scene_with(study_case, setting));
    return true;
  } catch (const wire::Error&) {
    return false;  // a server would refuse the scene with this setting
  }
}

namespace {

using physics::kLanes;

struct GridChoice {
  std::uint32_t cells;
  double grading;
};
// Uniform cells, cells that grow by a factor of 1e2 from the interface to the far end, and cells that grow by 1e3.
constexpr GridChoice kGrids[] = {{500, 1.0}, {100, 1.0},  {240, 1.02}, {120, 1.04}, {60, 1.08}, {30, 1.16},
                                 {15, 1.35}, {120, 1.06}, {60, 1.12},  {30, 1.25},  {15, 1.6},  {10, 2.0}};
constexpr GridChoice kQuickGrids[] = {{60, 1.08}, {15, 1.35}};
constexpr double kAccuracies[] = {1e-3, 1e-6};
constexpr int kSteps[] = {10, 20, 40, 100, 200, 400, 1000, 2000, 4000};
constexpr int kQuickSteps[] = {20, 100};
constexpr double kLongRun = 0.3;    // processor time of a run that is measured once  [s]
constexpr double kResolved = 10.0;  // least error of a run that counts as known, in errors of the reference

double cpu_seconds() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

double relative(double value, double reference) {
  return reference != 0.0 ? std::abs(value / reference - 1.0) : std::abs(value);
}

void mark_front(std::vector<Outcome>& outcomes, const Reference& reference) {
  for (Outcome& one : outcomes) {
    one.known_error = std::max(one.temperature_error, kResolved * reference.uncertainty);
    one.resolved = one.known_error <= one.temperature_error;
  }
  for (Outcome& one : outcomes) {
    if (!one.failure.empty()) continue;
    one.efficient = std::none_of(outcomes.begin(), outcomes.end(), [&](const Outcome& other) {
      return other.failure.empty() && &other != &one && other.ns_per_node <= one.ns_per_node &&
             (other.known_error < one.known_error ||
              (other.known_error == one.known_error && other.ns_per_node < one.ns_per_node));
    });
  }
}

}  // namespace

std::string Setting::text() const {
  if (tolerance > 0.0) return fmt::format("tolerance {:.0e}, {} steps", tolerance, steps);
  const char* integrator = sdirk2 ? "sdirk2" : "backward_euler";
  if (cells == 0) return fmt::format("modes {:.0e}, {}, {} steps", accuracy, integrator, steps);
  return fmt::format("{} cells x{:g}, {}, {} steps", cells, grading, integrator, steps);
}

Answer run(const StudyCase& study_case, testing::Rig& rig, std::span<const double> lengths,
           const std::function<void(const physics::TileOutputs&)>& watch) {
  const auto host = study_case.host(study_case);
  const double share = rig.conducted_share();
  const auto& stress = rig.inputs.wants_mean_stress ? rig.outputs.mean_shear_stress : rig.outputs.shear_stress;
  Answer answer;
  double time = 0.0;
  for (const double dt : lengths) {
    host->load(time, dt, rig.inputs);
    rig.step(dt);
    host->take(rig.outputs);
    time += dt;
    answer.impulse += std::abs(stress[0]) * dt;
    answer.work += rig.outputs.friction_heat[0] / share;
    if (watch) watch(rig.outputs);
    const double next = static_cast<double>(answer.time.size() + 1) / kSamples;
    if (time < study_case.end * (next - 1e-9)) continue;
    answer.time.push_back(time);
    answer.temperature.push_back(rig.outputs.interface_temperature[0]);
  }
  return answer;
}

Answer run(const StudyCase& study_case, const Setting& setting, Outcome& outcome, int repeats) {
  testing::Rig rig(service::scene_model(scene_with(study_case, setting)).options);
  const std::vector<double> lengths(static_cast<std::size_t>(setting.steps), study_case.end / setting.steps);
  const std::vector<double> at_rest = rig.committed;
  int first_order = 0, divided = 0;
  bool failed = false;
  double estimate = 0.0;
  Answer answer = run(study_case, rig, lengths, [&](const physics::TileOutputs& out) {
    first_order += (out.outcome[0] & physics::kFirstOrder) != 0;
    divided += (out.outcome[0] & physics::kSubstepped) != 0;
    if (setting.tolerance > 0.0) estimate = std::max(estimate, out.error_estimate[0]);
    failed = failed || (out.outcome[0] & physics::kFailed) != 0;
  });

  std::vector<double> seconds;
  for (int i = 0; i < repeats && (i == 0 || seconds.front() < kLongRun); ++i) {
    rig.committed = at_rest;
    rig.operators.reset();  // their making is part of a run
    const double started = cpu_seconds();
    run(study_case, rig, lengths);
    seconds.push_back(cpu_seconds() - started);
  }
  outcome.setting = setting;
  outcome.estimate = estimate;
  outcome.ns_per_node = 1e9 * median(seconds) / kLanes;
  outcome.ns_per_node_step = outcome.ns_per_node / setting.steps;
  outcome.state_bytes = shard::Shard::bytes_per_node({rig.model, false});
  const auto& layout = rig.model.layout();
  outcome.solves_per_step =
      static_cast<double>(layout.num_vertices + layout.num_hard_vertices + layout.num_heat_modes) *
      (setting.sdirk2 ? 2 : 1);
  outcome.first_order_share = static_cast<double>(first_order) / setting.steps;
  outcome.divided_share = static_cast<double>(divided) / setting.steps;
  if (failed) outcome.failure = "the solver gave no answer";
  return answer;
}

Answer combined(const Answer& a, double wa, const Answer& b, double wb) {
  Answer sum = a;
  for (std::size_t i = 0; i < a.temperature.size(); ++i)
    sum.temperature[i] = wa * a.temperature[i] + wb * b.temperature[i];
  sum.impulse = wa * a.impulse + wb * b.impulse;
  sum.work = wa * a.work + wb * b.work;
  return sum;
}

double apart(const Answer& a, const Answer& b) {
  double most = 0.0;
  for (std::size_t i = 0; i < a.temperature.size(); ++i)
    most = std::max(most, std::abs(a.temperature[i] - b.temperature[i]));
  return most;
}

Answer limit(const Answer& fine, const Answer& coarse, int order) {
  const double weight = order == 2 ? 1.0 / 3.0 : 1.0;
  return combined(fine, 1.0 + weight, coarse, -weight);
}

void set_errors(const StudyCase& study_case, const Answer& answer, const Reference& reference, Outcome& outcome) {
  const double range = melting_range(study_case);
  outcome.temperature_error = 0.0;
  for (std::size_t i = 0; i < answer.time.size(); ++i) {
    const double error = std::abs(answer.temperature[i] - reference.temperature(answer.time[i])) / range;
    outcome.temperature_error = std::isfinite(error) ? std::max(outcome.temperature_error, error) : error;
    if (!std::isfinite(error)) break;
  }
  outcome.impulse_error = relative(answer.impulse, reference.impulse);
  outcome.work_error = relative(answer.work, reference.work);
}

Reference reference_of(const StudyCase& study_case, bool quick) {
  return study_case.exact != nullptr ? study_case.exact(study_case) : by_extrapolation(study_case, quick);
}

namespace {

// Errors are told of T0: where it stays as it is, every setting has none.
void refuse_at_rest(const StudyCase& study_case, const Reference& reference) {
  constexpr double kLeastRise = 1e-6;  // relative to what is to melting
  const double range = melting_range(study_case);
  const double start = service::scene_model(study_case.scene).options.initial_temperature;
  for (int i = 1; i <= kSamples; ++i)
    if (std::abs(reference.temperature(study_case.end * i / kSamples) - start) > kLeastRise * range) return;
  throw std::runtime_error(
      fmt::format("the interface stays at {} K within {} s: precision is told of its temperature, so it must slip. "
                  "--velocity-jump, --pressure and --end change the case",
                  start, study_case.end));
}

}  // namespace

Result sweep(const StudyCase& study_case, const SweepOptions& options) {
  Result result{.study_case = &study_case, .reference = reference_of(study_case, options.quick), .outcomes = {}};
  refuse_at_rest(study_case, result.reference);

  std::vector<Setting> methods;
  const std::span<const GridChoice> grids =
      options.quick ? std::span<const GridChoice>(kQuickGrids) : std::span<const GridChoice>(kGrids);
  for (const bool sdirk2 : {false, true}) {
    for (const auto& [cells, grading] : grids)
      methods.push_back({.cells = cells, .grading = grading, .sdirk2 = sdirk2});
    for (const double accuracy : kAccuracies) methods.push_back({.sdirk2 = sdirk2, .accuracy = accuracy});
  }
  const std::span<const int> steps = options.quick ? std::span<const int>(kQuickSteps) : std::span<const int>(kSteps);
  for (Setting setting : methods) {
    for (const int count : steps) {
      setting.steps = count;
      try {
        Outcome outcome;
        set_errors(study_case, run(study_case, setting, outcome, options.repeats), result.reference, outcome);
        if (!std::isfinite(outcome.temperature_error)) outcome.failure = "not a number";
        result.outcomes.push_back(outcome);
      } catch (const wire::Error&) {
        break;  // a server would refuse the scene with this setting
      }
    }
  }
  mark_front(result.outcomes, result.reference);
  return result;
}

const Outcome* cheapest(const Result& result, double tolerance) {
  const Outcome* best = nullptr;
  for (const Outcome& one : result.outcomes) {
    if (!one.failure.empty() || one.known_error > tolerance) continue;
    if (best == nullptr || one.ns_per_node < best->ns_per_node) best = &one;
  }
  return best;
}

double message_ns(const StudyCase& study_case, const Setting& setting) {
  constexpr std::size_t kNodes = 1000;
  constexpr int kRounds = 60;
  server::Embedded server;
  std::vector<std::uint64_t> ids(kNodes);
  std::iota(ids.begin(), ids.end(), 1);
  // The host of this measurement applies no stress.
  Client client({.endpoint = server.endpoint(), .context = server.context(), .check_closure = CheckClosure::kOff});
  Session session = client.open(support::text_of(scene_with(study_case, setting)), "scene", ids);
  Batch request = Batch::of(wire::columns_in(Form::kFarField, session.opened.required_columns), session.node_ids.size(),
                            session.opened.tangential_components);
  const bool forced = study_case.scene.strategy() == v1::STRATEGY_FORCE_DRIVEN;
  std::ranges::fill(request.f64(Field::kVelocityJump), study_case.velocity_jump);
  std::ranges::fill(request.f64(Field::kPressure), study_case.pressure);
  if (forced) {
    std::ranges::fill(request.f64(Field::kMassSoft), study_case.mass);
    std::ranges::fill(request.f64(Field::kMassHard), study_case.mass);
  }
  std::vector<double> spent;
  for (int i = 0; i < kRounds; ++i) {
    const StepResult& result = session.advance(request, {.dt_s = study_case.end / setting.steps});
    spent.push_back(static_cast<double>(result.round_trip.count()) - static_cast<double>(result.upscale().solver_ns));
  }
  // Of all measured round trips the shortest has waited least for a processor.
  return *std::ranges::min_element(spent) / static_cast<double>(kNodes);
}

}  // namespace shearbus::study
