// The fast solver of layers with inertia is compared with the slow reference solver, from states that random histories
// reach.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "server/physics/solver/velocity_driven/inertia_stage.hpp"
#include "tests/support/random_physics.hpp"
#include "tests/support/waves.hpp"

namespace shearbus::testing {
namespace {

struct Worst {
  double stress = 0.0, velocity = 0.0, slip = 0.0, temperature = 0.0, strain = 0.0;
};

void expect_agreement(const Rig& rig, int l, const reference::NodeOutputs& twin, const reference::NodeState& state,
                      double dt, Worst& worst) {
  const TileOutputs& out = rig.outputs;
  const double V = std::abs(rig.inputs.velocity_jump[l]);
  // Differences of stress and velocity are relative to the scales s [Pa] and v [m/s], the largest in the layer. s is at
  // least 1 MPa, because a layer close to melting carries almost no stress; v is at least the velocity jump.
  double carried = 0.0, v = V;
  for (double stress : state.stress_field) carried = std::max(carried, std::abs(stress));
  const double s = std::max(1e6, carried);
  for (double velocity : state.layer_velocity) v = std::max(v, std::abs(velocity));
  const int n = rig.model.grid().num_cells();
  // Where neither carries a stress, rounding decides whether the interface slips or the vertex next to it flows.
  const bool molten = std::abs(twin.shear_stress) < kNoStress && twin.regime != Regime::kOpen;
  for (int i = 0; i <= n; ++i) {
    const std::size_t at = static_cast<std::size_t>(i);
    worst.stress = std::max(worst.stress, std::abs(stress_at(rig, i, l) - state.stress_field[at]) / s);
    ASSERT_NEAR(stress_at(rig, i, l), state.stress_field[at], 1e-9 * s) << i;
    ASSERT_NEAR(rig.T(i, l), state.temperature[at], 1e-8) << i;
    const double ep = state.plastic_strain[at];
    const double moved = v * dt / rig.model.grid().weight[at];
    if (i > 0 || !molten) {
      worst.strain = std::max(worst.strain, std::abs(rig.ep(i, l) - ep) / (ep + moved + 1e-6));
      ASSERT_NEAR(rig.ep(i, l), ep, 1e-9 * (ep + moved) + 1e-13) << i;
    }
    // Where nothing carries a stress, rounding decides where there is work.
    if (!state.heat_shape.empty() && carried > kNoStress) {
      ASSERT_NEAR(rig.heat_shape(i, l), state.heat_shape[at], 1e-6) << i;
    }
    if (at >= state.layer_velocity.size()) break;
    worst.velocity = std::max(worst.velocity, std::abs(velocity_in(rig, i, l) - state.layer_velocity[at]) / (v + 1e-3));
    ASSERT_NEAR(velocity_in(rig, i, l), state.layer_velocity[at], 1e-9 * (v + 1e-3)) << i;
  }
  const double size = V + std::abs(twin.sliding_velocity) + v;
  worst.temperature = std::max(worst.temperature, std::abs(out.interface_temperature[l] - twin.interface_temperature));
  ASSERT_NEAR(out.shear_stress[l], twin.shear_stress, 1e-9 * s);
  ASSERT_NEAR(out.friction_heat[l], twin.friction_heat, 1e-9 * (twin.friction_heat + s * std::max(V, v) * dt));
  const TileInputs& in = rig.inputs;
  const double impulse = rig.model.options().strategy == Strategy::kForceDriven
                             ? dt * (s + std::abs(in.stress_soft[l]) + std::abs(in.stress_hard[l]))
                             : 0.0;
  ASSERT_NEAR(out.velocity_jump_new[l], twin.velocity_jump_new,
              1e-9 * impulse * (1.0 / in.mass_soft[l] + 1.0 / in.mass_hard[l]) + 1e-15 * V);
  ASSERT_EQ((out.outcome[l] & kFirstOrder) != 0, twin.first_order);
  if (rig.model.layout().junction_strain != TileLayout::kAbsent && !molten) {
    const double most = dt * v / rig.model.options().junctions->height;
    ASSERT_NEAR(rig.junction_strain(l), state.junction_strain, 1e-9 * (state.junction_strain + most));
  }
  if (rig.model.layout().num_friction_states > 0 && !molten) {
    const InterfaceOptions& law = rig.model.options().interface;
    const bool remembers = law.friction_law == FrictionLaws::place<PrakashClifton>();
    const double most = remembers ? std::max(1.0, rig.inputs.pressure[l]) : dt * v / law.slip_length + 1.0;
    ASSERT_NEAR(rig.friction_state(l), state.friction_state, 1e-9 * (std::abs(state.friction_state) + most));
  }
  // Without stress rounding decides whether the interface slips.
  if (rig.model.layout().sticking != TileLayout::kAbsent && std::abs(twin.shear_stress) > 1e-6 * s) {
    ASSERT_EQ(rig.committed[rig.model.layout().sticking + static_cast<std::size_t>(l)] != 0.0, state.sticking);
  }
  // Rounding decides which slip goes along a stress next to 0, of a layer that melts.
  const bool forced = rig.model.options().strategy == Strategy::kForceDriven;
  if (std::abs(twin.shear_stress) < 1e3 * kNoStress && twin.regime != Regime::kOpen && (V > 0.0 || forced)) return;
  worst.slip = std::max(worst.slip, std::abs(out.sliding_velocity[l] - twin.sliding_velocity) / (size + 1e-3));
  ASSERT_NEAR(out.sliding_velocity[l], twin.sliding_velocity, 1e-9 * (size + 1e-3)) << out.shear_stress[l];
  if (std::abs(twin.sliding_velocity) > 1e-6 * size || twin.regime == Regime::kOpen) {
    ASSERT_EQ(out.regime[l], twin.regime) << "T0 " << twin.interface_temperature;
  }
}

constexpr int kNotAsked = 1000;

enum class Scenes { kSteinberg, kLawsWithARate, kContactLaws, kWorkHeat, kForceDriven, kForceDrivenWorkHeat };

class PhysicsWavesReference : public ::testing::TestWithParam<Scenes> {};
INSTANTIATE_TEST_SUITE_P(, PhysicsWavesReference,
                         ::testing::Values(Scenes::kSteinberg, Scenes::kLawsWithARate, Scenes::kContactLaws,
                                           Scenes::kWorkHeat, Scenes::kForceDriven, Scenes::kForceDrivenWorkHeat),
                         [](const auto& of) {
                           return of.param == Scenes::kSteinberg       ? "Steinberg"
                                  : of.param == Scenes::kLawsWithARate ? "LawsWithARate"
                                  : of.param == Scenes::kContactLaws   ? "ContactLaws"
                                  : of.param == Scenes::kWorkHeat      ? "WorkHeat"
                                  : of.param == Scenes::kForceDriven   ? "ForceDriven"
                                                                       : "ForceDrivenWorkHeat";
                         });

TEST_P(PhysicsWavesReference, FastAndSlowAgree) {
  Draw draw(47);
  Worst worst;
  int compared = 0, open = 0, coulomb = 0, flowing = 0, melting = 0, stages = 0;
  const bool rates = GetParam() == Scenes::kLawsWithARate, laws = GetParam() == Scenes::kContactLaws,
             both = GetParam() == Scenes::kForceDrivenWorkHeat, heats = both || GetParam() == Scenes::kWorkHeat,
             forced = both || GetParam() == Scenes::kForceDriven;
  // The reference searches the amount of heat of work, for each amount the stress of the contact and for each stress the
  // strain of each vertex.
  const int scenes = rates ? 12 : laws ? 30 : both ? 30 : heats ? 12 : forced ? 14 : 25;
  for (int scene = 0; scene < scenes; ++scene) {
    ModelOptions options = both     ? random_forced_inertia_heat_options(draw, false)
                           : laws   ? random_inertia_contact_options(draw, false)
                           : heats  ? random_inertia_heat_options(draw, false)
                           : forced ? random_forced_inertia_options(draw, false)
                                    : random_inertia_options(draw, false);
    options.grid.cells = both ? draw.integer(4, 12) : draw.integer(1, 8);
    if (forced && !both && scene % 10 == 8)
      follow_johnson_cook(options.soft, options.soft.yield_strength * draw.log_uniform(0.1, 5.0),
                          draw.log_uniform(1e-3, 0.2), draw.log_uniform(1e-3, 1e8), draw.log_uniform(0.4, 2.0), 300.0);
    else if (forced && !both && scene % 10 == 9)
      adopt_flow_law(options.soft, random_preston_tonks_wallace(draw));
    if (heats && !forced && scene % 5 == 0) adopt_flow_law(options.soft, random_preston_tonks_wallace(draw));
    if (rates && scene % 2 == 0)
      adopt_flow_law(options.soft, random_preston_tonks_wallace(draw));
    else if (rates)
      follow_johnson_cook(options.soft, options.soft.yield_strength * draw.log_uniform(0.1, 5.0),
                          draw.log_uniform(1e-3, 0.2), draw.log_uniform(1e-3, 1e8), draw.log_uniform(0.4, 2.0), 300.0);
    Rig rig(options);
    const int steps = both && !properties_of(options.soft.flow_law).has_wave_return ? 6 : 12;
    for (int step = 0; step < steps; ++step) {
      random_inputs(draw, rig, false);
      const double dt = random_dt(draw, false);
      const int lanes[] = {step % kLanes, (step + 3) % kLanes};
      std::vector<reference::NodeState> states;  // after the step of the twin
      std::vector<reference::NodeOutputs> twins;
      for (int l : lanes) {
        states.push_back(rig.node_state(l));
        twins.push_back(reference::advance_one(options, dt, rig.node_inputs(l), states.back()));
      }
      rig.step(dt);
      for (std::size_t k = 0; k < 2; ++k) {
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(step) + ", lane " +
                     std::to_string(lanes[k]));
        expect_agreement(rig, lanes[k], twins[k], states[k], dt, worst);
        if (::testing::Test::HasFatalFailure()) return;
        ++compared;
        stages += options.time_integrator == TimeIntegrator::kSdirk2 && !twins[k].first_order;
        open += twins[k].regime == Regime::kOpen;
        coulomb += twins[k].regime == Regime::kCoulomb;
        flowing += twins[k].regime == Regime::kTresca;
        melting += twins[k].regime == Regime::kMelting;
      }
    }
  }
  std::printf(
      "%d node-steps compared (open %d, coulomb %d, tresca %d, melting %d, of two stages %d): worst s %.1e, v %.1e, "
      "[v] %.1e, T0 "
      "%.1e K, ep %.1e\n",
      compared, open, coulomb, flowing, melting, stages, worst.stress, worst.velocity, worst.slip, worst.temperature,
      worst.strain);
  if (heats) melting = stages = kNotAsked;  // few interfaces melt by it, and two stages are of first order
  EXPECT_GT(std::min({open, coulomb, flowing, melting, stages}), rates ? 5 : forced ? 4 : 10);
}

}  // namespace
}  // namespace shearbus::testing
