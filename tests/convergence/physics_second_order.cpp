// The second-order heat scheme (SDIRK2), and models that keep the heat in modes, against exact solutions.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "server/physics/interface/friction_laws.hpp"
#include "tests/support/orders.hpp"
#include "tests/support/physics_rig.hpp"
#include "tests/support/two_half_spaces.hpp"

namespace shearbus::testing {
namespace {

constexpr double kPressure = 1e9;  // compression of the contact [Pa]
constexpr double kJump = 200.0;    // constant velocity jump [m/s]

// Options of a force-driven interface that slips under the friction stress mu P. Bodies as heavy as those of
// rise_after() keep their velocity jump, so the heat flux is constant.
ModelOptions coulomb_slip(TimeIntegrator integrator) {
  ModelOptions options = paper_options(Strategy::kForceDriven);
  options.interface = {0.05, 1e12};
  options.soft.melting_temperature = 1e5;
  options.soft.temperature_coefficient = 0.0;
  options.time_integrator = integrator;
  return options;
}

double rise_after(const ModelOptions& options, double t, int steps) {
  Rig rig(options, 1);
  rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e12;
  rig.set_all(kJump, kPressure);
  for (int n = 0; n < steps; ++n) rig.step(t / steps);
  EXPECT_EQ(rig.outputs.regime[0], Regime::kCoulomb);
  EXPECT_EQ(rig.outputs.outcome[0], 0);
  return rig.T(0) - options.initial_temperature;
}

double flux_of(const ModelOptions& options) {
  return heat_partition(options.soft, options.hard) * options.interface.friction_coefficient * kPressure * kJump;
}

TEST(PhysicsSecondOrder, ConstantFluxIsOffByItsConstantOverStepsSquared) {
  ModelOptions options = coulomb_slip(TimeIntegrator::kSdirk2);
  options.grid.cells = 8000;
  const double t = 100e-9;
  const Material& m = options.soft;
  const double exact = 2.0 * flux_of(options) / m.conductivity * std::sqrt(m.diffusivity * t / M_PI);
  Orders orders("constant flux into a half-space, SDIRK2, 8000 cells, steps: T0", 2.0, 0.2);
  for (int steps : {4, 8, 16, 32}) {
    const double error = rise_after(options, t, steps) / exact - 1.0;
    EXPECT_NEAR(std::abs(error) * steps * steps, 1.6e-2, 0.2e-2) << steps;
    orders.add(steps, error);
  }
}

// If the heat is kept in modes, backward Euler and SDIRK2 both integrate a constant flux exactly, whatever the step
// length: the only error is that of the modes.
TEST(PhysicsModes, ConstantFluxIsExactToTheAccuracyAskedFor) {
  for (FarBoundary far_boundary : {FarBoundary::kHalfSpace, FarBoundary::kInsulated, FarBoundary::kIsothermal}) {
    for (double accuracy : {1e-3, 1e-6, 1e-9}) {
      for (TimeIntegrator integrator : {TimeIntegrator::kBackwardEuler, TimeIntegrator::kSdirk2}) {
        ModelOptions options = coulomb_slip(integrator);
        options.grid.far_boundary = far_boundary;
        options.modes = {.accuracy = accuracy, .shortest_step = 1e-9, .longest_time = 1e-5};
        const HeatModes modes(HeatKernel(options.soft, options.grid), *options.modes);
        EXPECT_LE(modes.error, accuracy);
        double worst = 0.0;
        for (double t : {1e-8, 1e-7, 1e-6, 1e-5}) {  // at 1e-5 s the heat has reached the far face of the slab
          for (int steps : {1, 3, 10}) {
            const double rise = rise_after(options, t, steps);
            worst = std::max(worst, std::abs(rise / (flux_of(options) * modes.kernel.integral(t)) - 1.0));
          }
        }
        std::printf("modes, %s, accuracy %.0e, %s: %d terms, error of T0 %.1e\n",
                    far_boundary == FarBoundary::kHalfSpace ? "half-space" : "slab", accuracy,
                    integrator == TimeIntegrator::kSdirk2 ? "sdirk2" : "backward_euler",
                    static_cast<int>(modes.rate.size()), worst);
        EXPECT_LT(worst, accuracy);
      }
    }
  }
}

// The integral of the heat kernel of a slab must equal the image series of its insulated face, or of a held face, whose
// images have alternating signs, also around t = h^2/(160 alpha), where the kernel switches from the formula of a
// half-space to a series.
class SlabKernel : public ::testing::TestWithParam<FarBoundary> {};
INSTANTIATE_TEST_SUITE_P(, SlabKernel, ::testing::Values(FarBoundary::kInsulated, FarBoundary::kIsothermal),
                         [](const auto& face) {
                           return face.param == FarBoundary::kIsothermal ? "Isothermal" : "Insulated";
                         });
TEST_P(SlabKernel, IsThatOfTheImageSeries) {
  ModelOptions options = paper_options();
  options.grid.far_boundary = GetParam();
  const double sign = GetParam() == FarBoundary::kIsothermal ? -1.0 : 1.0;
  const HeatKernel slab(options.soft, options.grid);
  const auto ierfc = [](double x) { return std::exp(-x * x) / std::sqrt(M_PI) - x * std::erfc(x); };
  const double h = options.grid.thickness;
  for (double t : {1e-10, 1e-8, 0.9 * h * h / (160 * 48.9e-6), 1.1 * h * h / (160 * 48.9e-6), 1e-6, 1e-5, 1e-3}) {
    const double depth = std::sqrt(options.soft.diffusivity * t);
    double sum = ierfc(0.0);
    double of_sign = 2.0;
    for (int i = 1; i < 2000; ++i) sum += (of_sign *= sign) * ierfc(i * h / depth);
    EXPECT_NEAR(slab.integral(t) / (2.0 * depth / options.soft.conductivity * sum), 1.0, 1e-12) << t;
    if (slab.at(t) * t < 1e-10 * slab.integral(t)) continue;  // steady: the differences below are rounding
    // The derivative of integral(t) must be the kernel K(t), and that of moment(t) must be t K(t).
    const double e = 1e-4 * t;
    EXPECT_NEAR((slab.integral(t + e) - slab.integral(t - e)) / (2 * e * slab.at(t)), 1.0, 1e-7) << t;
    EXPECT_NEAR((slab.moment(t + e) - slab.moment(t - e)) / (2 * e * t * slab.at(t)), 1.0, 1e-7) << t;
  }
}

struct Arm {
  const char* name;
  bool modes;
  TimeIntegrator integrator;
  double order;
};

// Two plates brake each other by friction that softens with T0. Reference: the Volterra equation of the heat, coupled
// to the motion of the plates.
TEST(PhysicsSecondOrder, BrakedPlatesConvergeWithTheirOrder) {
  const test::HalfSpaces problem{
      .initial_jump = 100.0, .pressure = 11.2e9, .friction_coefficient = 0.3, .yield_strength = 200e6};
  const double end = 100e-9, mass = 1.0;
  // The error of the reference solution falls as intervals^-2, here to 2e-5 K.
  const test::HalfSpaceState exact = test::solve_braked_plates(problem, 2.0 / mass, end, 3000).back();
  for (const Arm& arm :
       {Arm{"profile, backward Euler", false, TimeIntegrator::kBackwardEuler, 1.0},
        Arm{"profile, SDIRK2", false, TimeIntegrator::kSdirk2, 2.0},
        Arm{"modes, backward Euler", true, TimeIntegrator::kBackwardEuler, 1.0},
        // The flux begins as q0 - c sqrt(t), which a linear flux in each step cannot follow. The order is therefore 1.5
        // and not 2.
        Arm{"modes, SDIRK2", true, TimeIntegrator::kSdirk2, 1.5}}) {
    ModelOptions options = graded(paper_options(Strategy::kForceDriven), 1200, 1.004);
    options.time_integrator = arm.integrator;
    if (arm.modes) options.modes = {.accuracy = 1e-9, .shortest_step = 1e-9, .longest_time = 1e-6};
    std::printf("braked plates at 100 ns, %s\n", arm.name);
    Orders of_T0("steps: T0 [K]", arm.order, 0.1, Orders::kMore),
        of_jump("steps: [V] [m/s]", arm.order, 0.1, Orders::kMore);
    for (int steps : {10, 20, 40}) {
      Rig rig(options, 1);
      rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = mass;
      double jump = problem.initial_jump;
      for (int n = 0; n < steps; ++n) {
        rig.set_all(jump, problem.pressure);
        rig.step(end / steps);
        ASSERT_EQ(rig.outputs.outcome[0], 0);
        jump = rig.outputs.velocity_jump_new[0];
      }
      of_T0.add(steps, std::abs(rig.T(0) - exact.temperature), steps == 40);
      of_jump.add(steps, std::abs(jump - exact.jump), steps == 40);
    }
  }
}

// A node that has slipped and comes to rest, its contact open, sleeps under SDIRK2: its modes decay exactly in time.
// Against a reference of many steps T0 keeps the second order of the steps that were solved before.
TEST(PhysicsSecondOrder, ASleepingNodeKeepsTheOrder) {
  ModelOptions options = graded(paper_options(Strategy::kForceDriven), 60, 1.08);
  options = two_sided(options);
  options.time_integrator = TimeIntegrator::kSdirk2;
  constexpr double kSlip = 40e-9, kRest = 400e-9;
  const auto T0_after = [&](bool sleeps, int steps, int& asleep) {
    ModelOptions own = options;
    own.sleep = sleeps;
    Rig rig(own, 1);
    rig.set_all(100.0, kPressure);
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e12;
    for (int n = 0; n < steps; ++n) rig.step(kSlip / steps);
    rig.set_all(0.0, -1.0);
    for (int n = 0; n < steps; ++n) {
      rig.step(kRest / steps);
      asleep += (rig.outputs.outcome[0] & kAsleep) != 0;
    }
    return rig.outputs.interface_temperature[0];
  };
  int none = 0;
  const double exact = T0_after(false, 8192, none);
  Orders orders("T0 of a sleeping node at rest under SDIRK2, steps: T0 [K]", 1.7, 0.0, Orders::kMore);
  for (const int steps : {64, 128, 256, 512}) {
    int asleep = 0;
    const double error = std::abs(T0_after(true, steps, asleep) - exact);
    const double awake = std::abs(T0_after(false, steps, none) - exact);
    EXPECT_GT(asleep, steps / 4);
    EXPECT_LE(error, 1.5 * awake);
    orders.add(steps, error);
  }
  EXPECT_EQ(none, 0);
}

// Where slip or flow is of first order, steps of SDIRK2 are those of backward Euler to the last bit and say so, and open
// contacts conduct to second order.
class FirstOrderSlip : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(, FirstOrderSlip,
                         ::testing::Values("Junctions", "PlasticLayer", "VelocityWeakening", "MeltFilm", "WorkHeat"),
                         [](const auto& part) { return std::string(part.param); });
TEST_P(FirstOrderSlip, IsBackwardEulerAndOpenContactsAreOfSecondOrder) {
  const std::string part = GetParam();
  const bool forced = part != "WorkHeat";
  ModelOptions options = graded(paper_options(forced ? Strategy::kForceDriven : Strategy::kVelocityDriven), 60, 1.08);
  options = two_sided(options);
  if (part == "Junctions") options.junctions = {0.5, 1e-7, options.soft};
  if (part == "PlasticLayer") options.plastic_layer = true;
  if (part == "WorkHeat") options.taylor_quinney_factor = 0.9;
  if (part == "MeltFilm") options.melt_film = MeltFilmOptions{.latent_heat = 4e5, .viscosity = 1e-3};
  if (part == "VelocityWeakening") {
    options.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
    options.interface.friction_coefficient_fast = 0.05;
    options.interface.velocity_decay = 0.01;
  }
  ModelOptions second = options;
  second.time_integrator = TimeIntegrator::kSdirk2;
  Rig one(options, 1), two(second, 1);
  for (Rig* rig : {&one, &two}) {
    rig->set_all(100.0, kPressure);
    for (int n = 0; n < 20; ++n) {
      rig->inputs.velocity_jump[0] = n == 0 || !forced ? 100.0 : rig->outputs.velocity_jump_new[0];
      rig->step(1e-9);
    }
  }
  EXPECT_EQ(one.committed, two.committed);
  EXPECT_EQ(one.outputs.outcome[0] & ~kOutsideDomain, 0);
  EXPECT_EQ(two.outputs.outcome[0] & ~kOutsideDomain, kFirstOrder);
  const auto open_T0 = [&](Rig rig, int steps) {
    rig.set_all(0.0, -1.0);
    for (int n = 0; n < steps; ++n) {
      rig.step(100e-9 / steps);
      EXPECT_EQ(rig.outputs.outcome[0], 0);
    }
    return rig.T(0);
  };
  const auto again = [&] {  // a rig cannot be copied
    Rig rig(second, 1);
    rig.committed = two.committed;
    return rig;
  };
  const double exact = open_T0(again(), 8192);
  Orders orders("an open contact after slip of first order, steps: T0", 2.0, 0.25);
  for (const int steps : {32, 64, 128}) orders.add(steps, std::abs(open_T0(again(), steps) - exact));
}

}  // namespace
}  // namespace shearbus::testing
