// The force-driven step with a flowing layer (MODEL.md, "Plastic layer"): limiting cases, order of accuracy, and
// oscillations that it must not show.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

ModelOptions plastic_options() {
  ModelOptions options = graded(paper_options(Strategy::kForceDriven));
  options.plastic_layer = true;
  return options;
}

void set_masses(Rig& rig, double zone = 5e-6) {
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.mass_soft[l] = 2703.0 * 0.5 * zone;
    rig.inputs.mass_hard[l] = 7900.0 * 0.5 * zone;
  }
}

// A layer of unlimited strength never flows. If the host's plastic strain rate is 0, the step must therefore equal that
// of the model without a plastic layer, to the last bit.
TEST(PhysicsPlasticLayer, StrongLayerIsTheSimplifiedModel) {
  constexpr double kSame = 1e-9;  // the kernels for a tile and the search for a lane
  Draw draw(21);
  for (int scene = 0; scene < 60; ++scene) {
    ModelOptions options = random_options(draw, Strategy::kForceDriven, scene % 2 == 1);
    if (!properties_of(options.soft.flow_law).has_ceiling) continue;  // only laws with Y_max, set to infinity below
    options.soft.yield_strength = 1e300;
    // a layer that melts as the pressure falls would have no strength
    options.soft.melting_curve = MeltingCurve::kConstant;
    options.soft.yield_strength_max = std::numeric_limits<double>::infinity();
    options.plastic_layer = true;
    options.modes.reset();
    options.time_integrator = TimeIntegrator::kBackwardEuler;
    ModelOptions simplified = options;
    simplified.plastic_layer = false;
    Rig rig(options), other(simplified);
    for (int step = 0; step < 20; ++step) {
      random_inputs(draw, rig, scene % 2 == 1);
      for (int l = 0; l < kLanes; ++l) {
        rig.inputs.soft_plastic_strain_rate[l] = 0.0;  // a model without a plastic layer ignores this input
        // A server refuses smaller masses. Below 1e-9 kg/m2 rounding of the jump would decide whether the interface
        // sticks.
        rig.inputs.mass_soft[l] = std::max(rig.inputs.mass_soft[l], 1e-9);
        rig.inputs.mass_hard[l] = std::max(rig.inputs.mass_hard[l], 1e-9);
      }
      other.inputs = rig.inputs;
      const double dt = random_dt(draw, scene % 2 == 1);
      rig.step(dt);
      other.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        const double stress = rig.outputs.shear_stress[l], heat = rig.outputs.friction_heat[l];
        const double jumps = std::abs(rig.inputs.velocity_jump[l]) + std::abs(rig.outputs.velocity_jump_new[l]);
        ASSERT_NEAR(stress, other.outputs.shear_stress[l], kSame * std::abs(stress)) << scene << " " << step;
        ASSERT_NEAR(rig.outputs.sliding_velocity[l], other.outputs.sliding_velocity[l], kSame * jumps);
        ASSERT_NEAR(rig.outputs.velocity_jump_new[l], other.outputs.velocity_jump_new[l], kSame * jumps);
        ASSERT_NEAR(heat, other.outputs.friction_heat[l], kSame * std::abs(heat));
        for (int i = 0; i < rig.model.grid().num_vertices(); ++i)
          ASSERT_NEAR(rig.T(i, l), other.T(i, l), kSame * other.T(i, l)) << i;
        ASSERT_EQ(rig.outputs.regime[l], other.outputs.regime[l]);
        ASSERT_EQ(rig.outputs.outcome[l], other.outputs.outcome[l]);
        ASSERT_EQ(rig.plastic_slip(l), 0.0);
      }
    }
  }
}

// Heavy bodies keep their jump, so the force-driven layer must flow like the velocity-driven layer. The interface is
// stronger than the layer, so that all shear is flow and none is friction heat. The jump is only 1 m/s because the
// velocity-driven step heats z = 0, and this heat must stay negligible.
TEST(PhysicsPlasticLayer, StuckInterfaceFlowsAsTheVelocityDrivenLayer) {
  ModelOptions options = plastic_options();
  options.interface = {10.0, 1e12};
  ModelOptions imposed = graded(paper_options(Strategy::kVelocityDriven));
  Rig rig(options, 1), other(imposed, 1);
  const double jump = 1.0;
  rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e6;
  rig.set_all(jump, 11.2e9);
  other.set_all(jump, 11.2e9);
  for (int n = 0; n < 50; ++n) {
    rig.inputs.velocity_jump[0] = jump;
    rig.step(1e-7);
    other.step(1e-7);
    ASSERT_NEAR(rig.outputs.velocity_jump_new[0], jump, 1e-4);
  }
  // The velocity-driven balance includes the elastic shear of the layer, the force-driven balance DLP (64) does not:
  // the plastic slips of the two models differ by h s / G0.
  const double elastic = options.grid.thickness * other.stress() / options.soft.shear_modulus;
  EXPECT_NEAR(rig.plastic_slip(), other.plastic_slip() + elastic, 1e-3 * rig.plastic_slip());
  EXPECT_EQ(rig.outputs.regime[0], Regime::kTresca);
  EXPECT_NEAR(rig.stress() / other.stress(), 1.0, 0.02);
}

// Two bodies with a relative velocity of 60 m/s and a weak layer between them. If the interface is stronger than the
// layer, it sticks, and the flow of the layer alone brakes the bodies. If friction limits the stress to the strength of
// the layer, the interface slips and the layer flows at the same time.
struct Stop {
  double stress, T0, jump, plastic_slip, interface_slip;
};
Stop stop_bodies(const ModelOptions& options, double zone, double prestrain, double dt, double end) {
  Rig rig(options, 1);
  set_masses(rig, zone);
  std::fill_n(rig.committed.data() + rig.model.layout().plastic_strain, rig.model.layout().num_strain_vertices * kLanes,
              prestrain);
  Stop stop{0.0, 0.0, 60.0, 0.0, 0.0};
  const int steps = static_cast<int>(std::lround(end / dt));
  for (int n = 0; n < steps; ++n) {
    rig.set_all(stop.jump, 11.2e9);
    rig.step(dt);
    EXPECT_LE(rig.outputs.velocity_jump_new[0], stop.jump) << n;
    EXPECT_GE(rig.outputs.velocity_jump_new[0], 0.0) << n;
    stop.jump = rig.outputs.velocity_jump_new[0];
    stop.interface_slip += rig.outputs.sliding_velocity[0] * dt;
  }
  stop.stress = rig.stress();
  stop.T0 = rig.T(0);
  stop.plastic_slip = rig.plastic_slip();
  return stop;
}

TEST(PhysicsPlasticLayer, ShorterStepsConvergeAtFirstOrder) {
  struct Case {
    const char* name;
    ModelOptions options;
    double zone, prestrain, end;
    bool interface_slips;
  };
  const auto with = [](const InterfaceOptions& interface) {
    ModelOptions options = plastic_options();
    options.interface = interface;
    return options;
  };
  // In the second case the prestrain hardens the layer to exactly mu P, so the layer flows only because friction at mu
  // P heats it.
  const double carried = 210e6;
  const Material soft = plastic_options().soft;
  const double hardened = carried * kSqrt3 / flow_stress(soft, 0.0, 11.2e9, 300.0);
  const double prestrain = (std::pow(hardened, 1.0 / soft.hardening_exponent) - 1.0) / soft.hardening_coefficient;
  // Junctions that harden from the strength of the layer on.
  ModelOptions junctions = with({10.0, carried * kSqrt3 / softening(soft, 11.2e9, 300.0).g});
  junctions.junctions = {1.0, 1e-5, soft};
  junctions.junctions->metal.yield_strength = junctions.interface.yield_strength;
  junctions.junctions->metal.hardening_coefficient = 1.0;
  junctions.junctions->metal.hardening_exponent = 0.3;
  ModelOptions heated = two_sided(with({0.3, 400e6}));
  heated.taylor_quinney_factor = 0.9;
  for (const Case& c : {Case{"stuck interface", with({0.3, 400e6}), 5e-6, 0.0, 1.024e-9, false},
                        Case{"slip beside flow", with({carried / 11.2e9, 1e9}), 100e-6, prestrain, 20.48e-9, true},
                        Case{"junctions beside flow", junctions, 100e-6, prestrain, 20.48e-9, true},
                        Case{"stuck, plastic work heats", heated, 100e-6, 0.0, 20.48e-9, false}}) {
    SCOPED_TRACE(c.name);
    const auto stop = [&](int steps) { return stop_bodies(c.options, c.zone, c.prestrain, c.end / steps, c.end); };
    const Stop exact = stop(4096);
    EXPECT_GT(exact.jump, 1.0);  // [m/s]: the bodies still slide when their states are compared
    const double before = kSqrt3 * 20e-6 * c.prestrain;
    EXPECT_GT(exact.plastic_slip, before * 1.001);
    double error[3][4];
    for (int k = 0; k < 3; ++k) {
      const Stop coarse = stop(64 << k);
      const double found[] = {coarse.stress / exact.stress, coarse.T0 / exact.T0, coarse.jump / exact.jump,
                              (coarse.plastic_slip - before) / (exact.plastic_slip - before)};
      for (int i = 0; i < 4; ++i) error[k][i] = std::abs(found[i] - 1.0);
      EXPECT_EQ(coarse.interface_slip > 0.1 * (coarse.plastic_slip - before), c.interface_slips);
    }
    constexpr const char* kNames[] = {"s", "T0", "[V]", "layer slip"};
    for (int i = 0; i < 4; ++i) {
      std::printf("%s, %s: relative error %.2e %.2e %.2e\n", c.name, kNames[i], error[0][i], error[1][i], error[2][i]);
      if (error[2][i] < 1e-10) continue;  // at the constant stress mu P, s and [V] do not depend on the step length
      EXPECT_NEAR(error[0][i] / error[1][i], 2.0, 0.25) << kNames[i];
      EXPECT_NEAR(error[1][i] / error[2][i], 2.0, 0.25) << kNames[i];
      EXPECT_LT(error[2][i], 0.01) << kNames[i];
    }
  }
}

TEST(PhysicsPlasticLayer, StickingDoesNotRing) {
  ModelOptions options = plastic_options();
  options.interface.yield_strength = 1e9;
  Rig rig(options, 1);
  set_masses(rig);
  double jump = 1.0, strain = 0.0;
  int flowing = 0;
  for (int n = 0; n < 500; ++n) {
    rig.set_all(jump, 11.2e9);
    rig.inputs.stress_soft[0] = 2.9e8 * std::sin(0.05 * n);
    rig.step(1e-9);
    const double before = jump;
    jump = rig.outputs.velocity_jump_new[0];
    ASSERT_LT(std::abs(jump), 60.0) << n;
    ASSERT_EQ(rig.committed[rig.model.layout().sticking], 1.0) << n;
    if (rig.outputs.regime[0] == Regime::kStick) {
      ASSERT_EQ(jump, 0.0) << n;
      ASSERT_EQ(rig.plastic_slip(), strain) << n;
    } else {
      ++flowing;
      ASSERT_GT(rig.plastic_slip(), strain) << n;
      // The jump never points against the stress, so it does not change its sign from step to step.
      ASSERT_GE(jump * rig.stress(), 0.0) << n << " from " << before;
    }
    strain = rig.plastic_slip();
  }
  EXPECT_GT(flowing, 5);
}

// Under a constant jump neither the stress nor the regime may oscillate near melting.
TEST(PhysicsPlasticLayer, NoChatterNearMelting) {
  for (double dt : {1e-9, 0.25e-9}) {
    for (double yield : {200e6, 260e6, 400e6}) {
      ModelOptions options = plastic_options();
      options.interface.yield_strength = yield;
      Rig rig(options, 1);
      rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e3;  // heavy bodies (1000 kg/m2) keep the jump
      int turns = 0, changes = 0;
      double s_before = 0.0, ds_before = 0.0;
      Regime regime = Regime::kOpen;
      const int steps = static_cast<int>(std::lround(1.5e-6 / dt));
      for (int n = 0; n < steps; ++n) {
        rig.set_all(150.0, 11.2e9);
        rig.step(dt);
        const double ds = rig.stress() - s_before;
        if (n > 2 && ds * ds_before < 0.0 && std::abs(ds) > 1e-6 * rig.stress()) ++turns;
        changes += rig.outputs.regime[0] != regime;
        regime = rig.outputs.regime[0];
        ds_before = ds;
        s_before = rig.stress();
      }
      EXPECT_LE(turns, 2) << dt << " " << yield;
      EXPECT_LE(changes, 4) << dt << " " << yield;
    }
  }
}

// The first vertex beside an interface that slips and heats hardens until it is as strong as the interface. From then on
// rounding must not decide whether the layer flows, and with it whether the interface sticks.
TEST(PhysicsPlasticLayer, SlipGoesOnBesideALayerAsStrongAsTheInterface) {
  constexpr double kStrength = 500e6;
  for (const double dt : {1e-9, 1e-10}) {
    ModelOptions options = graded(paper_options(Strategy::kForceDriven));
    options.plastic_layer = true;
    options.interface.yield_strength = kStrength;
    Rig rig(options, 1);
    rig.set_all(2000.0, 0.0);
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 4.0;
    rig.inputs.stress_soft[0] = rig.inputs.stress_hard[0] = 54e6;
    const int steps = static_cast<int>(std::lround(100e-9 / dt));
    int stuck = 0, several = 0;
    for (int n = 0; n < steps; ++n) {
      rig.inputs.pressure[0] = 0.3e9 * (1.0 + static_cast<double>(n) / steps);
      rig.step(dt);
      rig.inputs.velocity_jump[0] = rig.outputs.velocity_jump_new[0];
      stuck += rig.node_state(0).sticking;
      several += (rig.outputs.outcome[0] & kMultipleRoots) != 0;
    }
    EXPECT_EQ(stuck, 0) << dt;
    EXPECT_EQ(several, 0) << dt;
    EXPECT_NEAR(flow_stress(options.soft, rig.node_state(0).plastic_strain[0], 0.0, 300.0), kStrength,
                1e-3 * kStrength);
  }
}

// A zone that shears against the jump and faster than it drags the interface along with its shear.
TEST(PhysicsPlasticLayer, AShearAgainstTheJumpGivesTheStressItsDirection) {
  const ModelOptions options = plastic_options();
  const double per_rate = kSqrt3 * options.grid.thickness, rate = 25.0 / per_rate;
  Rig rig(options);
  set_masses(rig);
  // lanes: jump and shear, the shear alone, the jump alone, the mirror images of these; jump and shear that are none
  const double jump[kLanes] = {-5.0, 0.0, 20.0, 5.0, 0.0, -20.0, -per_rate * rate, 0.0};
  const double shear[kLanes] = {rate, 20.0 / per_rate, 0.0, -rate, -20.0 / per_rate, 0.0, rate, 0.0};
  rig.set_all(0.0, 11.2e9);
  std::copy_n(jump, kLanes, rig.inputs.velocity_jump);
  std::copy_n(shear, kLanes, rig.inputs.soft_plastic_strain_rate);
  rig.step(1e-9);
  const TileOutputs& out = rig.outputs;
  EXPECT_GT(out.shear_stress[0], 1e7);
  EXPECT_GT(out.sliding_velocity[0], 1.0);
  for (const int l : {0, 1, 2}) {
    EXPECT_NEAR(out.shear_stress[l] / out.shear_stress[2], 1.0, 1e-12);
    EXPECT_NEAR(out.sliding_velocity[l], out.sliding_velocity[2], 1e-10);
    EXPECT_NEAR(out.velocity_jump_new[l] + per_rate * shear[l], out.velocity_jump_new[2], 1e-12);
    EXPECT_EQ(out.shear_stress[l + 3], -out.shear_stress[l]);
    EXPECT_EQ(out.velocity_jump_new[l + 3], -out.velocity_jump_new[l]);
  }
  EXPECT_EQ(out.shear_stress[6], 0.0);
  EXPECT_EQ(out.velocity_jump_new[6], jump[6]);
  EXPECT_EQ(out.interface_temperature[6], out.interface_temperature[7]);
}

}  // namespace
}  // namespace shearbus::testing
