// Errors of force-driven nodes with a tolerance over random closed loops, in which the far stresses turn, the pressure
// changes and falls away, and slip starts, stops and turns: each request on the grid that it chooses, against an
// independent, finer model in many substeps.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <random>
#include <utility>
#include <vector>

#include "tests/support/fine_layer.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {

// One history: two bodies that far stresses pull, in steps of changing length.
class ForceLoop {
 public:
  explicit ForceLoop(unsigned seed) : random_(seed) {
    pull_ = between(50e6, 600e6);
    drift_ = between(-150e6, 150e6);
    period_ = between(0.1e-6, 1.5e-6);
    phase_ = between(0.0, 6.28);
    pressure_ = between(1e9, 12e9);
    lowest_ = between(-0.2, 0.9);
    mass_ = std::exp2(between(-4.0, 2.0));
    jump_ = between(-1.0, 1.0) < 0.0 ? 0.0 : between(-200.0, 200.0);
  }
  double start() const { return jump_; }
  double next_dt() { return 5e-9 * std::exp2(std::floor(between(0.0, 3.0))); }
  void load(double time, TileInputs& inputs) const {
    const double turn = std::sin(6.28 * time / period_ + phase_);
    inputs.active = 1;
    inputs.stress_soft[0] = pull_ * turn + drift_;
    inputs.stress_hard[0] = 0.5 * inputs.stress_soft[0];
    inputs.mass_soft[0] = mass_;
    inputs.mass_hard[0] = 2.0 * mass_;
    const double fallen = std::max(0.0, std::sin(3.0 * time / period_ + 2.0 * phase_));
    inputs.pressure[0] = pressure_ * (1.0 - (1.0 - lowest_) * fallen);
  }

 private:
  double between(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }

  std::mt19937 random_;
  double pull_, drift_, period_, phase_, pressure_, lowest_, mass_, jump_;
};

// The largest errors of one history: of T0, relative to what is to melting; of the sum of the impulses, relative to the
// sum of those of the largest stress, at least the cold strength of the interface; of the heat, relative to the sum of what
// warms z = 0 by what is to melting in each step. `jump` is that of the velocity jump, which is an impulse over a mass, as a
// change of T0 by its heat in a microsecond. Jump and impulse are held in each step, as a part of T0: over a history they
// add up, and no request is held to them.
struct LoopErrors {
  double T0 = 0.0, impulse = 0.0, heat = 0.0, jump = 0.0;
  double largest() const { return std::max(T0, heat); }
};

struct LoopAnswers {
  double request = 0.0;
  double work = 0.0;               // evaluations per step of a node (solver/work.hpp)
  double undivided = 0.0;          // the same of the same steps without a tolerance, on the same grid
  std::vector<LoopErrors> errors;  // one per history

  std::pair<double, double> over_request() const {  // median and largest of the histories, relative to the request
    std::vector<double> all;
    for (const LoopErrors& one : errors) all.push_back(one.largest() / request);
    std::ranges::sort(all);
    return {all[all.size() / 2], all.back()};
  }
};

struct LoopSeeds {
  unsigned first = 1, number = 6;
};

// Runs the histories of the seeds with each request, the smallest of which is the last. The reference has the grid or the
// modes of `finer` times the smallest request and `substeps` substeps of each step; one in which the jump turns or stops
// is halved up to 24 times.
inline std::vector<LoopAnswers> run_force_loops(const ModelOptions& scene, const LoopSeeds& seeds,
                                                const std::vector<double>& requests, int substeps, double finer = 0.1,
                                                int steps = 60) {
  ModelOptions reference = discretised(scene, finer * requests.back());
  reference.tolerance.reset();
  const double to_melting = scene.soft.melting_temperature - scene.initial_temperature;
  std::vector<LoopAnswers> answers;
  for (const double request : requests) answers.push_back({.request = request, .errors = {}});
  std::vector<ModelOptions> asked;
  for (const double request : requests) asked.push_back(discretised(scene, request));
  for (unsigned seed = seeds.first; seed < seeds.first + seeds.number; ++seed) {
    std::vector<Rig> rigs, undivided;
    for (ModelOptions options : asked) {
      rigs.emplace_back(options, 1U);
      options.tolerance.reset();
      undivided.emplace_back(options, 1U);
    }
    for (LoopAnswers& one : answers) one.errors.emplace_back();
    std::vector<double> heats(asked.size(), 0.0);
    std::vector<double> works(asked.size() * kLanes, 0.0), undivided_works = works;
    ForceLoop loop(seed);
    for (std::vector<Rig>* each : {&rigs, &undivided})
      for (Rig& rig : *each) rig.outputs.velocity_jump_new[0] = loop.start();
    TileInputs fine_inputs;
    fine_inputs.velocity_jump[0] = loop.start();
    test::FineLayer fine(reference, 1e-9);
    double heat = 0.0, heat_scale = 0.0, impulse = 0.0, impulse_scale = 0.0, time = 0.0;
    std::vector<double> impulses(asked.size(), 0.0);
    for (int n = 0; n < steps; ++n) {
      const double dt = loop.next_dt();
      time += dt;
      fine.set_substep(dt / substeps);
      loop.load(time, fine_inputs);
      TileOutputs exact{};
      for (int i = 0; i < substeps; ++i) fine.advance(fine_inputs, 1.0 / substeps, exact);
      heat += exact.friction_heat[0];
      impulse += dt * exact.shear_stress[0];
      impulse_scale += dt * std::max(scene.interface.yield_strength / std::sqrt(3.0), std::abs(exact.shear_stress[0]));
      const Material& soft = scene.soft;
      const double response = 2.0 / soft.conductivity * std::sqrt(soft.diffusivity / std::acos(-1.0));  // per sqrt(s)
      heat_scale += to_melting * std::sqrt(dt) / response;
      for (std::size_t i = 0; i < rigs.size(); ++i) {
        Rig& rig = rigs[i];
        loop.load(time, rig.inputs);
        rig.inputs.velocity_jump[0] = rig.outputs.velocity_jump_new[0];
        rig.inputs.work = works.data() + i * kLanes;
        rig.step(dt);
        loop.load(time, undivided[i].inputs);
        undivided[i].inputs.velocity_jump[0] = undivided[i].outputs.velocity_jump_new[0];
        undivided[i].inputs.work = undivided_works.data() + i * kLanes;
        undivided[i].step(dt);
        heats[i] += rig.outputs.friction_heat[0];
        impulses[i] += dt * rig.outputs.shear_stress[0];
        LoopErrors& errors = answers[i].errors.back();
        const double T0 = std::abs(rig.outputs.interface_temperature[0] - exact.interface_temperature[0]);
        const double jump = std::abs(rig.outputs.velocity_jump_new[0] - exact.velocity_jump_new[0]);
        const double warms = fine.conducted_share() * response * 1e-3 * std::abs(exact.shear_stress[0]);
        errors.T0 = std::max(errors.T0, T0 / to_melting);
        errors.jump = std::max(errors.jump, jump * warms / to_melting);
        errors.impulse = std::max(errors.impulse, std::abs(impulses[i] - impulse) / impulse_scale);
        errors.heat = std::max(errors.heat, std::abs(heats[i] - heat) / heat_scale);
      }
    }
    for (std::size_t i = 0; i < asked.size(); ++i) {
      answers[i].work += works[i * kLanes] / (steps * seeds.number);
      answers[i].undivided += undivided_works[i * kLanes] / (steps * seeds.number);
    }
  }
  return answers;
}

}  // namespace shearbus::testing
