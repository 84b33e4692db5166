// Tests junctions (MODEL.md, "Junctions"): the equations DLP (49-54) in limiting cases, and the search for the answer of
// a step.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/solver/parts.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

ModelOptions with_junctions(double fraction, double height) {
  ModelOptions options = graded(paper_options(Strategy::kForceDriven));
  options.junctions = {fraction, height, options.soft};
  return options;
}

void expect_same_bits(const Rig& with, const Rig& without, int lane) {
  const std::size_t shared = without.model.layout().doubles / kLanes;
  for (std::size_t i = 0; i < shared; ++i) {
    ASSERT_EQ(with.committed[i * kLanes + lane], without.committed[i * kLanes + lane]) << "row " << i;
  }
  ASSERT_EQ(with.outputs.sliding_velocity[lane], without.outputs.sliding_velocity[lane]);
  ASSERT_EQ(with.outputs.velocity_jump_new[lane], without.outputs.velocity_jump_new[lane]);
  ASSERT_EQ(with.outputs.friction_heat[lane], without.outputs.friction_heat[lane]);
  ASSERT_EQ(with.outputs.outcome[lane], without.outputs.outcome[lane]);
}

// With full contact (f = 1) and no hardening the step with junctions must be that of an interface without junctions,
// DLP (65), bit for bit and for any inputs.
TEST(PhysicsJunctions, FullContactWithoutHardeningIsTheSimplifiedLawBitForBit) {
  Draw draw(31);
  int compared = 0;
  for (int scene = 0; compared < 60; ++scene) {
    const bool extreme = scene % 2 == 1;
    ModelOptions options = random_options(draw, Strategy::kForceDriven, extreme);
    options.plastic_layer = false;
    options.junctions.reset();
    // the only time integrator that is allowed with junctions
    options.time_integrator = TimeIntegrator::kBackwardEuler;
    ModelOptions junctions = options;
    junctions.junctions = {1.0, 1e-7, options.soft};
    junctions.junctions->metal.flow_law = {};
    junctions.junctions->metal.yield_strength = options.interface.yield_strength;
    junctions.junctions->metal.yield_strength_max = std::numeric_limits<double>::infinity();
    junctions.junctions->metal.hardening_coefficient = 0.0;
    // the exponent of the soft metal may be invalid for the flow law of the junctions
    junctions.junctions->metal.hardening_exponent = 0.1;
    // Without junctions the kernels solve friction that falls with slip, with them the general search does.
    if (!refusals(junctions).empty() || properties_of(options.interface.friction_law).depends_on_slip()) continue;
    ++compared;
    Rig rig(junctions), other(options);
    for (int step = 0; step < 20; ++step) {
      random_inputs(draw, rig, extreme);
      other.inputs = rig.inputs;
      const double dt = random_dt(draw, extreme);
      rig.step(dt);
      other.step(dt);
      for (int l = 0; l < kLanes; ++l) expect_same_bits(rig, other, l);
      if (HasFatalFailure()) return;
    }
  }
}

// Junctions of almost zero height reach their saturation strength within the first slip. With full contact (f = 1) the
// answer must then equal that of an interface without junctions, DLP (65), of this strength, to the last bit.
TEST(PhysicsJunctions, VanishingHeightAndFullContactGiveTheSimplifiedLaw) {
  ModelOptions options = with_junctions(1.0, 1e-12);
  options.junctions->metal.yield_strength_max = 350e6;
  ModelOptions simplified = options;
  simplified.junctions.reset();
  simplified.interface.yield_strength = 350e6;
  Rig rig(options), other(simplified);
  for (Rig* r : {&rig, &other}) {
    for (int l = 0; l < kLanes; ++l) {
      r->inputs.pressure[l] = 11.2e9;
      r->inputs.velocity_jump[l] = 20.0 * (l + 1);
      r->inputs.mass_soft[l] = 2703 * 50e-6;
      r->inputs.mass_hard[l] = 7900 * 50e-6;
    }
  }
  bool stuck = false, slipping = false;
  for (int n = 0; n < 400; ++n) {
    rig.step(1e-9);
    other.step(1e-9);
    for (int l = 0; l < kLanes; ++l) {
      expect_same_bits(rig, other, l);
      stuck |= rig.outputs.regime[l] == Regime::kStick;
      slipping |= rig.outputs.regime[l] == Regime::kTresca;
      rig.inputs.velocity_jump[l] = other.inputs.velocity_jump[l] = rig.outputs.velocity_jump_new[l];
    }
    if (HasFatalFailure()) return;
  }
  EXPECT_TRUE(stuck && slipping);
}

// Heavy bodies keep their jump V, so the plastic strain of junctions of height d is ep_a = V t / (sqrt(3) d). Without
// thermal softening the stress is s = f Y_a(ep_a) / sqrt(3), whatever the step length, where f is the contact
// fraction and Y_a the strength of the junctions at this strain and pressure.
TEST(PhysicsJunctions, ConstantSlipHardensAsThePowerLawSays) {
  ModelOptions options = with_junctions(0.4, 1e-6);
  options.soft.temperature_coefficient = 0.0;
  options.soft.melting_temperature = 1e9;
  options.interface.friction_coefficient = 1.0;
  for (double dt : {1e-9, 1e-8}) {
    Rig rig(options, 1);
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e9;
    for (int n = 1; n <= 50; ++n) {
      rig.set_all(50.0, 11.2e9);
      rig.step(dt);
      const double strain = 50.0 * n * dt / (kSqrt3 * 1e-6);
      const double exact =
          0.4 * 200e6 * std::pow(1.0 + 125.0 * strain, 0.1) / kSqrt3 * softening(options.soft, 11.2e9, 300.0).g;
      ASSERT_NEAR(rig.stress() / exact, 1.0, 1e-9) << n;
      ASSERT_NEAR(rig.junction_strain() / strain, 1.0, 1e-9) << n;
    }
  }
}

// Near melting a step with junctions may have several answers. The search must return the answer with the most slip,
// which is the first zero of the balance in a scan of the stress from 0. The criterion of a unique answer must not
// accept a step that has two.
TEST(PhysicsJunctions, TheSearchForTheMostSlipFindsTheFirstZero) {
  const ModelOptions paper = paper_options(Strategy::kForceDriven);
  const double rise =
      heat_partition(paper.soft, paper.hard) * std::sqrt(paper.soft.diffusivity * 1e-9) / paper.soft.conductivity;
  Draw draw(32);
  constexpr int kPoints = 3000;
  int several = 0, searched = 0;
  for (int n = 0; n < 6000; ++n) {
    JunctionOptions options{1.0, draw.log_uniform(1e-10, 1e-6), paper.soft};
    options.metal.yield_strength = draw.uniform(100e6, 700e6);
    options.metal.yield_strength_max = options.metal.yield_strength * draw.uniform(1.0, 3.0);
    options.metal.hardening_coefficient = draw.log_uniform(0.01, 100.0);
    options.metal.hardening_exponent = draw.uniform(0.1, 1.0);
    const double per_stress = draw.log_uniform(5e-8, 8e-7);
    const StressLimit limit{0.3 * 11.2e9, 0.0, 11.2e9, &paper.soft, junctions_of(&options, 0.0, 1e-9)};
    const FrictionHeating heating{draw.uniform(1205.0, 1219.5), rise, draw.log_uniform(5.0, 80.0), 0.5 * per_stress};
    const double a_stick = 2.0 * heating.c / per_stress;
    const bool unique = slip_is_unique(limit, heating, a_stick);
    if (unique && n % 10 != 0) continue;
    double first = 0.0;
    int zeros = 0;
    bool spare = true;
    for (int i = 1; i <= kPoints; ++i) {
      const double a = a_stick * i / kPoints;
      if ((spare_strength(limit, heating, a) > 0.0) == spare) continue;
      spare = !spare;
      if (zeros++ == 0) first = a;
    }
    if (unique) {
      ASSERT_LE(zeros, 1) << n;
    } else if (zeros > 0) {
      const SlipSearch search = most_slip_stress(limit, heating, a_stick);
      ASSERT_TRUE(search.found) << n;
      ASSERT_NEAR(search.stress, first, 1.01 * a_stick / kPoints) << n;
      ASSERT_NEAR(spare_strength(limit, heating, search.stress) / search.stress, 0.0, 1e-7) << n;
      ++searched;
      several += zeros > 1;
    }
  }
  EXPECT_GT(searched, 300);
  EXPECT_GT(several, 50);
}

// Next to sticking the slip is a small difference of large velocities, and junctions of almost no height harden with it:
// the slip must be found to the last digits of these velocities, as bisection finds it.
TEST(PhysicsJunctions, SlipNextToStickingIsFoundToItsLastDigits) {
  Draw draw(77);
  const Material soft = paper_options().soft;
  int near = 0;
  double worst = 0.0;
  for (int n = 0; n < 2000; ++n) {
    JunctionOptions options{draw.uniform(0.1, 1.0), draw.log_uniform(1e-13, 1e-11), soft};
    options.metal.yield_strength = draw.uniform(50e6, 700e6);
    options.metal.yield_strength_max = 4.0 * options.metal.yield_strength;
    options.metal.hardening_coefficient = draw.log_uniform(1.0, 10.0);
    options.metal.hardening_exponent = draw.uniform(0.1, 1.0);
    const StressLimit limit{std::numeric_limits<double>::infinity(), 0.0, 11.2e9, &soft,
                            junctions_of(&options, 0.0, 1e-6)};
    // Bodies that stick under a stress between the limits of fresh and of hardened junctions.
    const double fresh = limit.at(400.0, 0.0).stress;
    const FrictionHeating heating{400.0, 1e-12, 300.0, 300.0 / (fresh * draw.uniform(1.001, 3.0))};
    const double a_stick = heating.c / heating.b;
    if (spare_strength(limit, heating, a_stick) >= 0.0) continue;
    double low = 0.0, high = a_stick;
    for (double middle = 0.5 * high; middle > low && middle < high; middle = 0.5 * (low + high))
      (spare_strength(limit, heating, middle) > 0.0 ? low : high) = middle;
    const double found = heating.slip(slip_stress(limit, heating, a_stick, 0.5 * a_stick));
    near += heating.slip(high) < 1e-6 * heating.c;
    worst = std::max(worst, std::abs(found - heating.slip(high)) / heating.c);
  }
  EXPECT_GT(near, 100);
  EXPECT_LT(worst, 16.0 * std::numeric_limits<double>::epsilon());
}

}  // namespace
}  // namespace shearbus::testing
