// The kernels of the force-driven step, which solve all lanes of a tile at once: their forms of friction, the step of
// one lane beside that of its tile, and what a step searches.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <variant>

#include "server/physics/solver/force_driven/interface_step.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

// The coefficient of a form, written out.
double coefficient(const FrictionForm& form, double T_melt, double T0, double slip) {
  if (const auto* constant = std::get_if<ConstantCoefficient>(&form)) return constant->coefficient;
  if (const auto* falls = std::get_if<FallsWithSlip>(&form))
    return falls->fast + (falls->at_rest - falls->fast) * std::exp(-falls->decay * slip);
  const auto& softens = std::get<FallsWithTemperature>(form);
  const double share = std::max(0.0, (T0 - softens.reference) / (T_melt - softens.reference));
  return softens.cold * (1.0 - std::pow(share, softens.exponent));
}

TEST(PhysicsForceDrivenKernels, AFormIsTheCoefficientOfItsLaw) {
  const Material soft = paper_options().soft;
  constexpr double states[kMostFrictionStates] = {};
  int laws = 0;
  (void)FrictionLaws::any([&](auto own) {
    using Law = typename decltype(own)::type;
    InterfaceOptions options = Law::typical({0.3, 200e6}, soft);
    options.friction_law = FrictionLaws::place<Law>();
    const FrictionForm form = form_of(options);
    if (std::holds_alternative<NoForm>(form)) return false;
    ++laws;
    for (double T0 = 5.0; T0 < soft.melting_temperature; T0 += 45.0) {
      for (const double slip : {0.0, 1e-3, 1.0, 70.0, 5000.0}) {
        const double expected = Law::at(options, soft, {1.0, T0, slip, 1e-9, states}).stress;
        EXPECT_NEAR(coefficient(form, soft.melting_temperature, T0, slip), expected, 4e-15 * expected) << Law::kName;
      }
    }
    return false;
  });
  EXPECT_EQ(laws, 3);  // a law without a form is solved lane by lane: correct, and several times slower
}

ModelOptions sliding(const std::string& option) {
  ModelOptions options = graded(paper_options(Strategy::kForceDriven), 40, 1.1);
  if (option == "junctions") options.junctions = {0.5, 1e-7, options.soft};
  if (option == "weakening") options.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
  if (option == "softening") options.interface.friction_law = FrictionLaws::place<ThermalSoftening>();
  if (option == "second order") options.time_integrator = TimeIntegrator::kSdirk2;
  options.interface.friction_coefficient_fast = 0.02;
  options.interface.velocity_decay = 0.01;
  options.interface.friction_reference_temperature = 300.0;
  options.interface.friction_softening_exponent = 2.0;
  return options;
}

// Without the kernels a step evaluates the limit of each lane some eight times.
TEST(PhysicsForceDrivenKernels, SearchTheLanesOfEveryLawTogether) {
  for (const std::string option : {"none", "junctions", "weakening", "softening", "second order"}) {
    for (const double pressure : {0.2e9, 11.2e9}) {  // friction, and yield
      Rig rig(sliding(option));
      rig.set_all(100.0, pressure);
      for (int l = 0; l < kLanes; ++l) {
        rig.inputs.mass_soft[l] = rig.inputs.mass_hard[l] = 10e-3;
        rig.inputs.velocity_jump[l] += l;
      }
      for (int n = 0; n < 20; ++n) rig.step(1e-9);
      SearchEffort effort;
      rig.inputs.effort = &effort;
      rig.step(1e-9);
      const int stages = option == "second order" ? 2 : 1;
      EXPECT_LE(effort.limit_values, 4 * stages * kLanes) << option << " at " << pressure << " Pa";
      EXPECT_GT(effort.limit_values, 0);
      for (int l = 0; l < kLanes; ++l) {
        EXPECT_EQ(rig.outputs.outcome[l], 0);
        EXPECT_EQ(rig.outputs.regime[l] == Regime::kCoulomb, pressure < 1e9) << option;
      }
    }
  }
}

// The search of one lane (substeps, sleeping nodes and layers that flow) has the answers of the kernels over all lanes.
TEST(PhysicsForceDrivenKernels, OneLaneAgreesWithItsTile) {
  constexpr double kSame = 1e-10;
  Draw draw(31);
  int compared = 0, hardened = 0;
  for (int scene = 0; scene < 60; ++scene) {
    ModelOptions options = random_options(draw, Strategy::kForceDriven, false);
    options.plastic_layer = false;
    options.time_integrator = TimeIntegrator::kBackwardEuler;
    options.interface.friction_law = {};
    options.modes.reset();
    if (scene % 2 == 0)
      options.junctions = {draw.uniform(0.2, 1.0), draw.log_uniform(1e-9, 1e-6), paper_options().soft};
    if (!refusals(options).empty()) continue;
    Rig rig(options);
    const Problem problem(options);
    for (int step = 0; step < 15; ++step) {
      random_inputs(draw, rig, false);
      const double dt = random_dt(draw, false);
      const std::vector<double> before = rig.committed;
      rig.step(dt);
      const HeatOperator& heat = rig.operators->heat();
      std::vector<double> T(before.size());
      conduct(heat, problem.heat_rows, before.data() + problem.layout.first_temperature(), T.data());
      const LaneMaterials soft_at(options.soft, rig.inputs);
      for (int l = 0; l < kLanes; ++l) {
        if (rig.outputs.outcome[l] != 0) continue;
        InterfaceStep interface_step(problem, rig.inputs, before.data(), soft_at(l), l);
        const LaneStep alone =
            interface_step.from(InterfaceStep::before(problem.layout, rig.inputs, before.data(), l), dt,
                                *heat.layer_response(), T[static_cast<std::size_t>(heat.interface * kLanes + l)]);
        // A slip next to rest is a difference of jumps.
        const double jumps = std::abs(alone.slip) + std::abs(alone.jump_new) + std::abs(rig.inputs.velocity_jump[l]);
        ASSERT_NEAR(alone.stress, rig.outputs.shear_stress[l], kSame * std::abs(alone.stress))
            << "scene " << scene << ", step " << step;
        ASSERT_NEAR(alone.slip, rig.outputs.sliding_velocity[l], kSame * jumps);
        ASSERT_NEAR(alone.jump_new, rig.outputs.velocity_jump_new[l], kSame * jumps);
        ASSERT_EQ(alone.regime, rig.outputs.regime[l]);
        ++compared;
        if (!options.junctions) continue;
        ASSERT_NEAR(interface_step.contact.junction_strain, rig.junction_strain(l), kSame * rig.junction_strain(l));
        hardened += alone.regime == Regime::kTresca;
      }
    }
  }
  EXPECT_GT(compared, 2000);
  EXPECT_GT(hardened, 100);
}

}  // namespace
}  // namespace shearbus::testing
