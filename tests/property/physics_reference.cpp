// The fast solvers are compared with the slow scalar reference solver, from states that random histories reach.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "tests/support/random_physics.hpp"
#include "tests/support/strategies.hpp"
#include "tests/support/twin.hpp"

namespace shearbus::testing {
namespace {

bool follows_slip(const ModelOptions& options) {
  return options.junctions ||
         (has_friction(options) && properties_of(options.interface.friction_law).depends_on_slip());
}

class PhysicsReference : public ::testing::TestWithParam<Strategy> {};

TEST_P(PhysicsReference, FastAndSlowAgree) {
  Draw draw(11);
  Worst worst;
  int compared = 0, ambiguous = 0, several = 0, sent_back = 0, second_order = 0, without_profile = 0;
  int johnson_cook = 0, preston = 0, weakening = 0, softening = 0, heated = 0, flowing_junctions = 0;
  int sliding = 0, remembering = 0, rate_and_state = 0;
  for (int scene = 0; scene < 80; ++scene) {
    ModelOptions options = random_options(draw, GetParam(), false);
    options.grid.cells = draw.integer(1, 16);
    draw_work_heat(draw, options);
    // Friction next to a velocity-driven layer is drawn so low that it often is the limit.
    if (GetParam() == Strategy::kVelocityDriven && scene % 2 == 0) {
      Draw aside(scene);
      options.friction_coefficient = aside.log_uniform(1e-4, 0.03);
      options.interface.friction_law = {};
      options.junctions.reset();
      draw_other_contact(aside, false, options);
      if (!goes_with(Property::kSecondOrder, options)) options.time_integrator = TimeIntegrator::kBackwardEuler;
    }
    // Prakash and Clifton's law is drawn seldom under force.
    if (ModelOptions other = options; GetParam() == Strategy::kForceDriven && scene % 8 == 5) {
      Draw aside(scene);
      draw_state_law(aside, other);
      other.interface.friction_law = FrictionLaws::place<PrakashClifton>();
      if (refusals(other).empty()) options = other;
    }
    // With a flowing layer the reference solver scans for slips, and at every vertex of every scan point it inverts the
    // law of Preston, Tonks and Wallace by bisection. These scenes are costly, so they have few vertices and steps.
    // So it does next to a velocity-driven layer, whose contact follows its slip.
    const bool scans = options.plastic_layer || (GetParam() == Strategy::kVelocityDriven && follows_slip(options));
    const bool costly = scans && options.soft.flow_law == FlowLaws::place<PrestonTonksWallace>();
    if (costly) options.grid.cells = std::min(options.grid.cells, 5);
    // The strain increment DLP (48) divides by the hardening coefficient, which therefore must not be 0.
    if (options.soft.hardening_coefficient == 0.0) options.soft.hardening_coefficient = 125.0;
    Rig rig(options);
    start_hard_elsewhere(draw, rig);
    const int lanes[] = {1, kLanes - 1, kLanes};  // number of active lanes: one, all but one, all
    rig.inputs.active = (1u << lanes[scene % 3]) - 1u;
    for (int step = 0; step < 12; ++step) {
      random_inputs(draw, rig, false);
      const double dt = random_dt(draw, false);
      if (costly && step >= 6) continue;  // the random draws go on, so that other scenes do not depend on this cut
      std::vector<reference::NodeState> twin_states;
      std::vector<reference::NodeOutputs> twins;
      std::vector<std::vector<double>> strains;
      for (int l = 0; l < lanes[scene % 3]; ++l) {
        twin_states.push_back(rig.node_state(l));
        strains.push_back(twin_states.back().plastic_strain);
        twins.push_back(reference::advance_one(options, dt, rig.node_inputs(l), twin_states.back()));
      }
      rig.step(dt);
      // The fast solver falls back to the first-order scheme where its criterion cannot show that the answer is unique.
      // This criterion is sufficient, not necessary, so the reference solver may not have fallen back. It then repeats
      // the step with the first-order scheme.
      for (int l = 0; l < lanes[scene % 3]; ++l) {
        // An interface that sticks after that is not marked.
        const bool sticks_alone = rig.outputs.regime[l] == Regime::kStick && twins[l].regime != Regime::kStick;
        const bool may_fall_back = options.time_integrator == TimeIntegrator::kSdirk2;
        const bool fell_back = (rig.outputs.outcome[l] & kFirstOrder) || (may_fall_back && sticks_alone);
        if (!fell_back || twins[l].first_order) continue;
        reference::NodeInputs inputs = rig.node_inputs(l);
        inputs.backward_euler = true;
        std::swap(rig.committed, rig.trial);  // rig.committed becomes the state before the step
        twin_states[l] = rig.node_state(l);
        std::swap(rig.committed, rig.trial);
        twins[l] = reference::advance_one(options, dt, inputs, twin_states[l]);
        ++sent_back;
      }
      for (int l = 0; l < lanes[scene % 3]; ++l) {
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(step) + ", lane " +
                     std::to_string(l));
        if (rig.outputs.outcome[l] & kSubstepped) {
          ++ambiguous;
          continue;
        }
        // with a flowing layer several answers may exist even if the criterion of a unique answer holds
        if (options.plastic_layer && twins[l].answers > 1) {
          ++several;
          continue;
        }
        ASSERT_EQ(twins[l].answers, 1);  // a step that was not divided met the criterion of a unique answer
        try {
          require_agreement(rig, strains[l], twins[l], twin_states[l], l, dt, worst);
        } catch (const Broken& broken) {
          FAIL() << broken.what();
        }
        ++compared;
        second_order += options.time_integrator == TimeIntegrator::kSdirk2 && rig.outputs.outcome[l] == 0;
        without_profile += options.modes.has_value();
        const bool slides = rig.outputs.sliding_velocity[l] != 0.0;
        johnson_cook += options.soft.flow_law == FlowLaws::place<JohnsonCook>() && slides;
        preston += options.soft.flow_law == FlowLaws::place<PrestonTonksWallace>() && slides;
        const FrictionLawProperties friction = properties_of(options.interface.friction_law);
        weakening += friction.depends_on_slip() && rig.outputs.regime[l] == Regime::kCoulomb;
        const bool rubs = rig.outputs.regime[l] == Regime::kCoulomb;
        sliding += follows_slip(options) && rubs;
        remembering += options.interface.friction_law == FrictionLaws::place<PrakashClifton>() && rubs;
        rate_and_state += options.interface.friction_law == FrictionLaws::place<RateAndState>() && rubs;
        heated += GetParam() == Strategy::kForceDriven && options.taylor_quinney_factor && rig.ep(0, l) > strains[l][0];
        flowing_junctions += options.plastic_layer && options.junctions && slides;
        softening += friction.depends_on_temperature && rig.outputs.regime[l] == Regime::kCoulomb;
      }
    }
  }
  std::printf(
      "%d node-steps compared (%d divided, %d with several answers, %d of second order, %d sent back, %d without "
      "profile): worst s %.1e, T0 %.1e K, [v] %.1e\n",
      compared, ambiguous, several, second_order, sent_back, without_profile, worst.stress, worst.temperature,
      worst.slip);
  EXPECT_GT(compared, 2000);
  EXPECT_LT(several, compared / 100);
  EXPECT_GT(johnson_cook, 200);
  EXPECT_GT(preston, 200);
  EXPECT_GT(second_order, 100);
  EXPECT_GT(sliding, 100);
  EXPECT_GT(softening, GetParam() == Strategy::kVelocityDriven ? 5 : 50);
  EXPECT_GT(remembering, 30);
  EXPECT_GT(rate_and_state, 30);
  if (GetParam() == Strategy::kVelocityDriven) {
    EXPECT_GT(worst.shapes, 500);
  } else {
    EXPECT_GT(weakening, 50);
    EXPECT_GT(heated, 50);
    EXPECT_GT(flowing_junctions, 50);
  }
}

INSTANTIATE_TEST_SUITE_P(, PhysicsReference, support::both<Strategy>(), support::name_of_strategy);

}  // namespace
}  // namespace shearbus::testing
