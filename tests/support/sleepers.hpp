// Histories in which nodes come to rest, sleep and wake, and a model without sleep that takes the same steps.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "server/physics/solver/around/sleep.hpp"
#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/broken.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {

inline constexpr int kStepsPerPhase = 60;  // enough for a node at rest to fall asleep

// What the host does to each lane (node) in the kStepsPerPhase steps of a phase. `open`: the contact is open. `quiet`:
// the velocity jump starts at 0 and the far stresses are reduced. `lets_go`: the host slowly unloads a quiet lane.
struct Phase {
  bool open[kLanes], quiet[kLanes], lets_go[kLanes];
};

// Draws a phase and the inputs of its first step.
inline Phase begin_phase(Draw& draw, Rig& rig, bool extreme) {
  Phase phase{};
  rig.model.options().tangential_components == 2 ? random_vectors(draw, rig, extreme)
                                                 : random_inputs(draw, rig, extreme);
  for (int l = 0; l < kLanes; ++l) {
    phase.open[l] = draw.chance(0.3);
    phase.quiet[l] = draw.chance(0.7);
    phase.lets_go[l] = draw.chance(0.3);
    if (!phase.open[l] && rig.inputs.pressure[l] <= 0.0) rig.inputs.pressure[l] = draw.log_uniform(1e6, 30e9);
    if (phase.open[l]) rig.inputs.pressure[l] = -1.0;
    if (!phase.quiet[l]) continue;
    // The inputs of a quiet lane: the far stresses are 0.001 to 1 times those drawn, and the velocity jump starts at 0.
    const double share = draw.log_uniform(1e-3, 1.0);
    TileInputs& in = rig.inputs;
    in.velocity_jump[l] = in.second_velocity_jump[l] = 0.0;
    in.soft_plastic_strain_rate[l] = in.second_soft_plastic_strain_rate[l] = 0.0;
    for (double* rows : {in.stress_soft, in.stress_hard, in.second_stress_soft, in.second_stress_hard})
      rows[l] *= share;
    in.soft_shear_rate[l] = draw.chance(0.5) ? 0.0 : draw.sign() * draw.log_uniform(1.0, 1e4);
  }
  return phase;
}

// Sets the inputs of the next step in a phase.
inline void within_phase(const Phase& phase, Rig& rig) {
  const bool forced = rig.model.options().strategy == Strategy::kForceDriven;
  for (int l = 0; l < kLanes; ++l) {
    if (forced && phase.quiet[l]) {
      rig.inputs.velocity_jump[l] = rig.outputs.velocity_jump_new[l];
      rig.inputs.second_velocity_jump[l] = rig.outputs.second_velocity_jump_new[l];
    } else if (phase.quiet[l] && phase.lets_go[l]) {
      rig.inputs.velocity_jump[l] = -1e-9 * rig.stress(l);
    }
  }
}

// Counts of a history with sleep.
struct Slept {
  long asleep = 0;     // node-steps of sleeping nodes
  long stuck = 0;      // those under a stress
  long woken = 0;      // node-steps in which a sleeping node woke
  double apart = 0.0;  // largest difference of T0 between a sleeping node and the same node awake  [K]

  void add(const Slept& other) {
    asleep += other.asleep;
    stuck += other.stuck;
    woken += other.woken;
    apart = std::max(apart, other.apart);
  }
};

// The model of a rig, without sleep. It repeats each step of the rig from the temperatures that the rig's nodes had.
class AwakeTwin {
 public:
  explicit AwakeTwin(const ModelOptions& options) : problem_(options), awake_(without_sleep(options)) {}

  // Repeats the rig's last step and requires that all bits are equal, except those of T0 in lanes that went on sleeping:
  // these must be within kSleeperGrain.
  void repeat(const Rig& rig, double dt, Slept& slept) {
    const TileLayout& layout = awake_.model.layout();
    std::copy_n(rig.trial.begin(), layout.doubles, awake_.committed.begin());
    std::uint32_t sleeping = 0;
    for (int l = 0; l < kLanes; ++l) {
      if (!physics::asleep(rig.model.layout(), rig.trial.data(), l)) continue;
      sleeping |= 1u << l;
      profile_of(problem_, rig.trial.data(), l, awake_.committed.data() + layout.first_temperature());
    }
    awake_.inputs = rig.inputs;
    awake_.inputs.effort = nullptr;
    awake_.step(dt);
    physics::TileLedger here, there;
    record_energy(rig, here);
    record_energy(awake_, there);
    for (const int l : physics::lanes_of(sleeping)) compare_heat(here, there, l);
    for (const int l : physics::lanes_of(rig.inputs.active)) compare(rig, l, (sleeping >> l & 1u) != 0, slept);
  }

 private:
  static ModelOptions without_sleep(ModelOptions options) {
    options.sleep = false;
    return options;
  }

  static void record_energy(const Rig& rig, physics::TileLedger& ledger) {
    rig.model.record_energy(*rig.operators, rig.inputs, rig.outputs, rig.trial.data(), rig.committed.data(), ledger);
  }

  // The stored heat of a sleeper is that of its temperatures.
  void compare_heat(physics::TileLedger& here, physics::TileLedger& there, int l) const {
    const double heat = awake_.stored_heat(0.0, l), of_one_kelvin = heat - awake_.stored_heat(1.0, l);
    for (const auto term :
         {physics::LedgerTerm::kStoredSoft, physics::LedgerTerm::kStoredHard, physics::LedgerTerm::kHeatResidual})
      require(std::abs(here(term, l) - there(term, l)) <= 2.0 * kSleeperGrain * of_one_kelvin + 1e-11 * heat,
              "lane {}: stored heat {:.17g} J/m2 asleep, {:.17g} awake", l, here(term, l), there(term, l));
  }

  void compare(const Rig& rig, int l, bool slept_before, Slept& slept) const {
    const TileOutputs &here = rig.outputs, &there = awake_.outputs;
    const TileLayout& layout = awake_.model.layout();
    const bool sleeps = (here.outcome[l] & kAsleep) != 0;
    require((here.outcome[l] & ~kAsleep) == there.outcome[l], "lane {}: outcome {} asleep, {} awake", l,
            here.outcome[l], there.outcome[l]);
    require(here.regime[l] == there.regime[l], "lane {}: another regime awake", l);
    const auto same = [&](const char* what, double ours, double awake) {
      require(ours == awake, "lane {}: {} is {:.17g} with sleep, {:.17g} awake", l, what, ours, awake);
    };
    same("s", here.shear_stress[l], there.shear_stress[l]);
    same("[v]", here.sliding_velocity[l], there.sliding_velocity[l]);
    same("[V]", here.velocity_jump_new[l], there.velocity_jump_new[l]);
    same("heat", here.friction_heat[l], there.friction_heat[l]);
    if (rig.model.options().tangential_components == 2)
      same("second s", here.second_shear_stress[l], there.second_shear_stress[l]);
    for (std::size_t i = layout.temperature + layout.num_vertices * kLanes + static_cast<std::size_t>(l);
         i < layout.doubles; i += kLanes)
      same("a state", rig.committed[i], awake_.committed[i]);
    const double off = std::abs(here.interface_temperature[l] - there.interface_temperature[l]);
    require(std::abs(rig.model.interface_temperature(rig.committed.data(), l) - here.interface_temperature[l]) <=
                1e-13 * here.interface_temperature[l],
            "lane {}: T0 of the state is not the answered one", l);
    require(off <= (sleeps ? kSleeperGrain : 0.0), "lane {}: T0 is {:.3g} K from that awake", l, off);
    slept.apart = std::max(slept.apart, off);
    slept.asleep += sleeps;
    slept.stuck += sleeps && here.regime[l] == Regime::kStick && here.shear_stress[l] != 0.0;
    slept.woken += !sleeps && slept_before;
  }

  physics::Problem problem_;
  Rig awake_;
};

}  // namespace shearbus::testing
