// Errors of a velocity-driven layer with a tolerance over random histories: each request on the grid that it chooses,
// against an independent, finer grid and many substeps.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <random>
#include <utility>
#include <vector>

#include "server/physics/interface/search_effort.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {

// Eight histories, one per lane, in which the jump turns while the pressure falls and returns, in steps of changing
// length.
class TurningHistories {
 public:
  explicit TurningHistories(unsigned seed) : random_(seed) {
    for (int l = 0; l < kLanes; ++l) {
      swing_[l] = between(20.0, 200.0);
      drift_[l] = between(-50.0, 50.0);
      period_[l] = between(0.3e-6, 2e-6);
      phase_[l] = between(0.0, 6.28);
      pressure_[l] = between(2e9, 12e9);
      lowest_[l] = between(-0.1, 0.9);
      returns_[l] = between(0.3e-6, 1.5e-6);  // some pressures return suddenly within the run, others do not
    }
  }

  double next_dt() { return 1e-8 * std::exp2(std::floor(between(-1.0, 2.0))); }

  TileInputs load(double time) const {
    TileInputs inputs;
    inputs.active = (1u << kLanes) - 1u;
    inputs.wants_mean_stress = true;
    for (int l = 0; l < kLanes; ++l) {
      inputs.velocity_jump[l] = swing_[l] * std::cos(6.28 * time / period_[l] + phase_[l]) + drift_[l];
      const double fallen = time < returns_[l] ? (1.0 - lowest_[l]) * std::min(1.0, time / 0.6e-6) : 0.0;
      inputs.pressure[l] = pressure_[l] * (1.0 - fallen);
    }
    return inputs;
  }

 private:
  double between(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }

  std::mt19937 random_;
  double swing_[kLanes], drift_[kLanes], period_[kLanes], phase_[kLanes];
  double pressure_[kLanes], lowest_[kLanes], returns_[kLanes];
};

// A tile of a model, advanced by steps of any length.
struct SummedLayer {
  explicit SummedLayer(const ModelOptions& options)
      : model(options), state(model.layout().doubles), next(state.size()) {
    double temperature[kLanes];
    std::fill_n(temperature, kLanes, options.initial_temperature);
    model.initialise(state.data(), temperature);
  }
  void step(double dt, int times, const TileInputs& load) {
    TileInputs inputs = load;
    inputs.effort = &effort;
    const auto operators = model.operators(dt);
    for (int i = 0; i < times; ++i, std::swap(state, next)) {
      model.advance(*operators, inputs, state.data(), next.data(), outputs);
      for (int l = 0; l < kLanes; ++l) {
        impulse[l] += outputs.mean_shear_stress[l] * dt;
        heat[l] += outputs.friction_heat[l];
      }
    }
  }
  Model model;
  std::vector<double> state, next;
  TileOutputs outputs{};
  SearchEffort effort;
  double impulse[kLanes] = {};  // of the mean stress since the start  [Pa s]
  double heat[kLanes] = {};     // friction heat since the start  [J/m2]
};

// The largest errors of one history: of T0, relative to what the layer has to melting, and of the sums of impulse and
// heat, relative to the sums of their scales over the steps (METHODS.md, "Error of a substep").
struct TurningErrors {
  double T0 = 0.0, impulse = 0.0, heat = 0.0;
  double largest() const { return std::max({T0, impulse, heat}); }
};

// The answers to one request in all histories, and what they cost.
struct TurningAnswers {
  double request = 0.0;
  double sums = 0.0;                  // of the flow over the layer of a tile, per step of the host
  std::vector<TurningErrors> errors;  // one per history

  // Median and largest over the histories, relative to the request.
  template <typename Error>
  std::pair<double, double> over_request(Error error) const {
    std::vector<double> all;
    for (const TurningErrors& one : errors) all.push_back(std::invoke(error, one) / request);
    std::ranges::sort(all);
    return {all[all.size() / 2], all.back()};
  }
};

// Runs eight histories for each of the seeds 1 to `seeds` with each request, the smallest of which is the last. The
// reference has the grid of a tenth of the smallest request, and 256 substeps in a step of the host (1,024 below 1e-4),
// more where a stress turns or falls or a pressure returns. It begins each step with a very short substep: the pressure
// of the step holds from its start, and a stress above the new yield stress relaxes at once.
inline std::vector<TurningAnswers> run_turning_histories(unsigned seeds, const std::vector<double>& requests) {
  constexpr int kSteps = 60;
  constexpr double kShortest = 0x1p-24, kLeastHeat = 0.03, kReturned = 1.01;
  const bool strict = requests.back() < 0.99e-4;
  const int substeps = strict ? 1024 : 256, substeps_of_turn = strict ? 8192 : 4096;
  ModelOptions scene = paper_options();
  scene.grid.far_boundary = FarBoundary::kHalfSpace;
  ModelOptions reference = discretised(scene, 0.1 * requests.back());
  reference.tolerance.reset();
  const double yield_stress = scene.soft.yield_strength / kSqrt3;
  const double beta_T = heat_partition(scene.soft, scene.hard);
  const double to_melting = scene.soft.melting_temperature - scene.initial_temperature;
  std::vector<TurningAnswers> answers;
  answers.reserve(requests.size());
  for (const double request : requests) answers.push_back({.request = request, .errors = {}});
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    SummedLayer fine(reference);
    std::vector<SummedLayer> asked;
    asked.reserve(requests.size());
    for (const double request : requests) asked.emplace_back(discretised(scene, request));
    for (TurningAnswers& one : answers) one.errors.resize(one.errors.size() + kLanes);
    double impulse_scale[kLanes] = {}, heat_scale[kLanes] = {}, time = 0.0;
    TurningHistories histories(seed);
    TileInputs inputs;
    for (int n = 0; n < kSteps; ++n) {
      const double dt = histories.next_dt();
      time += dt;
      const TileInputs last = std::exchange(inputs, histories.load(time));
      bool turns = n == 0;
      for (int l = 0; l < kLanes; ++l) {
        const double before = fine.outputs.shear_stress[l];
        const bool returns = inputs.pressure[l] > kReturned * last.pressure[l];
        turns = turns || returns || before * inputs.velocity_jump[l] < 0.0 || before == 0.0;
      }
      for (SummedLayer& layer : asked) layer.step(dt, 1, inputs);
      const int parts = turns ? substeps_of_turn : substeps;
      fine.step(dt * kShortest, 1, inputs);
      fine.step(dt / parts, parts, inputs);
      const double response = fine.model.operators(dt)->heat().layer_response()[0];
      for (int l = 0; l < kLanes; ++l) {
        const double most = std::max(yield_stress, std::abs(fine.outputs.shear_stress[l]));
        impulse_scale[l] += dt * most;
        heat_scale[l] +=
            dt * std::max(beta_T * std::abs(inputs.velocity_jump[l]) * most, kLeastHeat * to_melting / response);
        for (std::size_t i = 0; i < asked.size(); ++i) {
          const SummedLayer& found = asked[i];
          TurningErrors& errors = answers[i].errors[std::size_t{seed - 1} * kLanes + static_cast<std::size_t>(l)];
          const double off = found.outputs.interface_temperature[l] - fine.outputs.interface_temperature[l];
          errors.T0 = std::max(errors.T0, std::abs(off) / to_melting);
          errors.impulse = std::max(errors.impulse, std::abs(found.impulse[l] - fine.impulse[l]) / impulse_scale[l]);
          errors.heat = std::max(errors.heat, std::abs(found.heat[l] - fine.heat[l]) / heat_scale[l]);
        }
      }
    }
    for (std::size_t i = 0; i < asked.size(); ++i)
      answers[i].sums += static_cast<double>(asked[i].effort.layer_sums) / (kSteps * seeds);
  }
  return answers;
}

}  // namespace shearbus::testing
