// The fast solvers against the slow twin, from the states random histories reach.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

struct Worst {
  double stress = 0.0, temperature = 0.0, slip = 0.0;
  int shapes = 0;  // shares of heat compared closely
};

// Relative agreement to expect of two roots of the same balance. The last Newton step is below 1e-10 of the stress and
// may cross the kink where a vertex begins to flow; each root is resolved to an ulp of T0, which softening multiplies.
double resolution(const Material& m, double pressure, double T0) {
  const Softening soften = softening(m, pressure, T0);
  if (soften.g == 0.0) return 1.0;
  return 5e-10 + 4e-13 * std::abs(soften.slope) * T0 / (std::max(soften.g, 1e-300) * flow_exponent(m));
}

void expect_agreement(const Rig& rig, const std::vector<double>& ep_old, const reference::NodeOutputs& twin,
                      const reference::NodeState& twin_state, int l, double dt, Worst& worst) {
  const TileOutputs& out = rig.outputs;
  const Material soft = at_pressure(rig.model.options().soft, rig.inputs.pressure[l]);
  const double T_hottest = *std::max_element(twin_state.temperature.begin(), twin_state.temperature.end());
  const double eps = resolution(soft, rig.inputs.pressure[l], T_hottest);
  const bool flows = rig.model.layout().plastic_strain != TileLayout::kAbsent;
  const double s = std::abs(twin.shear_stress);
  ASSERT_NEAR(out.shear_stress[l], twin.shear_stress, eps * s + 1e-6);
  ASSERT_NEAR(out.interface_temperature[l], twin.interface_temperature, 1e-9);
  const double size = std::abs(rig.inputs.velocity_jump[l]) + std::abs(twin.sliding_velocity) +
                      rig.model.options().grid.thickness * std::abs(rig.inputs.soft_shear_rate[l]) +
                      rig.model.options().grid.thickness * s / (soft.shear_modulus * dt);
  // The printed (48) takes differences of strains: their rounding over dt is a velocity.
  double strain = strain_scale(soft);
  for (double ep : twin_state.plastic_strain) strain = std::max(strain, ep);
  double noise = 1e-14 * strain * rig.model.options().grid.thickness / (dt * flow_exponent(soft));
  if (flows) noise += kSqrt3 * flow_grain(rig, ep_old, rig.stress(l), l, dt) / dt;
  ASSERT_NEAR(out.sliding_velocity[l], twin.sliding_velocity, (1e-8 + eps) * size + noise);
  const double driven = dt * (std::abs(rig.inputs.stress_soft[l]) / rig.inputs.mass_soft[l] +
                              std::abs(rig.inputs.stress_hard[l]) / rig.inputs.mass_hard[l]);
  ASSERT_NEAR(out.velocity_jump_new[l], twin.velocity_jump_new,
              1e-9 * (std::abs(twin.velocity_jump_new) + std::abs(rig.inputs.velocity_jump[l])) + 1e-12 * driven);
  ASSERT_NEAR(out.friction_heat[l], twin.friction_heat, eps * twin.friction_heat + 1e-9);
  ASSERT_EQ((out.outcome[l] & kFirstOrder) != 0, twin.first_order);
  if (std::abs(twin.sliding_velocity) > noise || twin.regime == Regime::kOpen) {
    ASSERT_EQ(out.regime[l], twin.regime) << "T0 " << twin.interface_temperature;
  }
  for (std::size_t i = 0; i < rig.model.layout().num_vertices; ++i) {
    ASSERT_NEAR(rig.T(static_cast<int>(i), l), twin_state.temperature[i], 1e-9);
  }
  // The shape is a ratio of strains of the step: known as well as they are, at the hottest vertex worst.
  const double share_noise = 1e-6 + 100.0 * noise / std::abs(twin.sliding_velocity) +
                             1e3 * resolution(soft, rig.inputs.pressure[l], T_hottest);
  for (std::size_t i = 0; i < twin_state.heat_shape.size() && twin.sliding_velocity != 0.0; ++i) {
    ASSERT_NEAR(rig.heat_shape(static_cast<int>(i), l), twin_state.heat_shape[i], share_noise) << i;
    if (share_noise < 1e-4) ++worst.shapes;
  }
  const int num_hard = static_cast<int>(rig.model.layout().num_hard_vertices);
  for (int i = 0; i < num_hard; ++i) {
    ASSERT_NEAR(rig.T(i - num_hard, l), twin_state.hard_temperature[static_cast<std::size_t>(i)], 1e-9);
  }
  if (s > 0.0) worst.stress = std::max(worst.stress, std::abs(out.shear_stress[l] / twin.shear_stress - 1.0));
  worst.temperature = std::max(worst.temperature, std::abs(out.interface_temperature[l] - twin.interface_temperature));
  if (size > noise) worst.slip = std::max(worst.slip, std::abs(out.sliding_velocity[l] - twin.sliding_velocity) / size);
}

class PhysicsReference : public ::testing::TestWithParam<Strategy> {};

TEST_P(PhysicsReference, FastAndSlowAgree) {
  Draw draw(11);
  Worst worst;
  int compared = 0, ambiguous = 0, several = 0, sent_back = 0, second_order = 0, without_profile = 0;
  int johnson_cook = 0, weakening = 0;
  for (int scene = 0; scene < 80; ++scene) {
    ModelOptions options = random_options(draw, GetParam(), false);
    options.grid.cells = draw.integer(1, 16);
    if (options.soft.hardening_coefficient == 0.0) options.soft.hardening_coefficient = 125.0;  // (48) divides by it
    Rig rig(options);
    start_hard_elsewhere(draw, rig);
    const int lanes[] = {1, kLanes - 1, kLanes};  // part of a tile, nearly all, all
    rig.inputs.active = (1u << lanes[scene % 3]) - 1u;
    for (int step = 0; step < 12; ++step) {
      random_inputs(draw, rig, false);
      const double dt = random_dt(draw, false);
      std::vector<reference::NodeState> twin_states;
      std::vector<reference::NodeOutputs> twins;
      std::vector<std::vector<double>> strains;
      for (int l = 0; l < lanes[scene % 3]; ++l) {
        twin_states.push_back(rig.node_state(l));
        strains.push_back(twin_states.back().plastic_strain);
        twins.push_back(reference::advance_one(options, dt, rig.node_inputs(l), twin_states.back()));
      }
      rig.step(dt);
      // Where the criterion of a single answer, which is sufficient and not necessary, sent the fast solver back.
      for (int l = 0; l < lanes[scene % 3]; ++l) {
        if (!(rig.outputs.outcome[l] & kFirstOrder) || twins[l].first_order) continue;
        reference::NodeInputs inputs = rig.node_inputs(l);
        inputs.backward_euler = true;
        std::swap(rig.committed, rig.trial);  // to the states before
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
        if (options.plastic_layer && twins[l].answers > 1) {  // the criterion is that of a layer that does not flow
          ++several;
          continue;
        }
        ASSERT_EQ(twins[l].answers, 1);  // not divided: the criterion promised a single answer
        expect_agreement(rig, strains[l], twins[l], twin_states[l], l, dt, worst);
        if (::testing::Test::HasFatalFailure()) return;
        ++compared;
        second_order += options.time_integrator == TimeIntegrator::kSdirk2 && rig.outputs.outcome[l] == 0;
        without_profile += options.modes.has_value();
        johnson_cook += is_johnson_cook(options.soft) && rig.outputs.sliding_velocity[l] != 0.0;
        weakening += options.interface.friction_law != FrictionLaw{} && rig.outputs.regime[l] == Regime::kCoulomb;
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
  EXPECT_GT(second_order, 100);
  if (GetParam() == Strategy::kVelocityDriven) {
    EXPECT_GT(worst.shapes, 500);
  } else {
    EXPECT_GT(weakening, 50);
  }
}

INSTANTIATE_TEST_SUITE_P(, PhysicsReference, ::testing::Values(Strategy::kVelocityDriven, Strategy::kForceDriven),
                         [](const auto& test) {
                           return test.param == Strategy::kVelocityDriven ? "VelocityDriven" : "ForceDriven";
                         });

// Work bound: a half-space pinned at melting takes no more heat, whatever the history.
TEST(PhysicsWorkBound, NoHistoryDoesMoreWorkThanAMoltenInterface) {
  Draw draw(12);
  for (Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    ModelOptions options = graded(paper_options(strategy));
    options.grid.far_boundary = FarBoundary::kHalfSpace;
    const double e = options.soft.conductivity / std::sqrt(options.soft.diffusivity) +
                     options.hard.conductivity / std::sqrt(options.hard.diffusivity);
    EXPECT_NEAR(e, 24706, 1.0);
    Rig rig(options);
    double work[kLanes] = {};
    double fullest = 0.0;
    const double dt = 1e-9;
    for (int n = 1; n <= 3000; ++n) {
      for (int l = 0; l < kLanes; ++l) {
        if (n % 100 == 1) rig.inputs.velocity_jump[l] = draw.sign() * draw.log_uniform(1.0, 1e4);
        rig.inputs.pressure[l] = 11.2e9;
      }
      rig.step(dt);
      const double t = n * dt;
      // Backward Euler pins a little more heat into its first steps than the exact kernel: 1/(8n).
      const double bound = 2 * e * (1220 - 300) * std::sqrt(t / M_PI) * (1 + 0.25 / n);
      for (int l = 0; l < kLanes; ++l) {
        work[l] += rig.outputs.friction_heat[l] / heat_partition(options.soft, options.hard);
        ASSERT_LE(work[l], bound) << "step " << n << ", lane " << l;
        fullest = std::max(fullest, work[l] / bound);
      }
    }
    EXPECT_GT(fullest, 0.5);  // the bound is near enough to mean something
  }
}

}  // namespace
}  // namespace shearbus::testing
