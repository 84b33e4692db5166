// Steps layers with inertia in random scenes, states and inputs: every equation of a step must hold to rounding.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <limits>
#include <string>

#include "tests/support/random_physics.hpp"
#include "tests/support/waves.hpp"

namespace shearbus::testing {
namespace {

constexpr double kTiny = 1e-280;
// Residuals are relative to the largest stress plus kLeastStress, or the largest velocity plus kLeastVelocity, because
// a layer close to melting may carry almost no stress.
constexpr double kLeastStress = 1e6;      // added to the largest stress, to which residuals are relative  [Pa]
constexpr double kLeastVelocity = 1e-20;  // added to the largest velocity, to which residuals are relative  [m/s]

// Relative tolerance of the flow stress of a vertex: 1e-9, and the change that an ulp of the temperature causes.
double limit_tolerance(const Material& soft, double pressure, double T) {
  const Softening soften = softening(soft, pressure, T);
  if (soften.g <= 0.0) return 1.0;
  return 1e-9 + 4e-16 * T * std::abs(soften.slope) / soften.g;
}

class Step {
 public:
  Step(Rig& rig, int lane)
      : soft_(at_pressure(rig.model.options().soft, rig.inputs.pressure[lane])), step_(wave_step(rig, lane, soft_)) {
    fill_fields(rig, lane, before_);
    fill_fields(rig, lane, after_);
  }
  Step(const Step&) = delete;
  Step& operator=(const Step&) = delete;

  void solve(int newton_steps = kWaveNewtonSteps) { answer_ = advance_waves(step_, after_, newton_steps); }

  double T(int i) const { return before_.T_ad[i] + answer_.flux * step_.response[i]; }
  double velocity(int cell) const {
    return cell < 0 ? answer_.interface_slip : cell < cells() ? after_.velocity[cell] : step_.jump;
  }
  int cells() const { return step_.grid->num_cells(); }
  double stress_before(int i) const { return before_.stress[i]; }
  double largest_stress() const {
    double s = 0.0;
    for (int i = 0; i <= cells(); ++i) s = std::max({s, std::abs(after_.stress[i]), std::abs(before_.stress[i])});
    return s;
  }
  double largest_velocity() const {
    double v = std::abs(step_.jump);
    for (int c = 0; c < cells(); ++c) v = std::max({v, std::abs(after_.velocity[c]), std::abs(before_.velocity[c])});
    return v;
  }

  // Residual of DLP (36): the largest error of the momentum balance of a cell, relative to momentum_size().
  double momentum_fault() const {
    double worst = 0.0;
    for (int c = 0; c < cells(); ++c) {
      const double gained = mass(c) * (after_.velocity[c] - before_.velocity[c]);
      const double given = step_.dt * (after_.stress[c + 1] - after_.stress[c]);
      worst = std::max(worst, (std::abs(gained - given) - kTiny) / momentum_size(c));
    }
    return worst;
  }

  double mass(int cell) const { return soft_.density * step_.grid->width[cell]; }

  // Scale of the momentum balance of cell c: momentum of the cell plus impulse of the stresses on the cell. Rounding a
  // velocity by one ulp changes the stresses of the cell's two vertices; the impulse of this change is added, times
  // 1e10.
  double momentum_size(int c) const {
    const double ulp_stress = soft_.shear_modulus * step_.dt * 2.2e-16 * largest_velocity() *
                              (1 / step_.grid->weight[c] + 1 / step_.grid->weight[c + 1]);
    return step_.dt * (largest_stress() + kLeastStress + 1e10 * ulp_stress) + mass(c) * largest_velocity();
  }

  // Residual of DLP (37), the balance of stress growth, shear and plastic flow at a vertex: largest of all vertices.
  double kinematic_fault() const {
    double worst = 0.0;
    for (int i = 0; i <= cells(); ++i) {
      const double per_velocity = soft_.shear_modulus * step_.dt / step_.grid->weight[i];
      const double loaded = per_velocity * (velocity(i) - velocity(i - 1));
      const double flowed = std::copysign(kSqrt3 * soft_.shear_modulus * after_.strain_growth[i], after_.stress[i]);
      const double size =
          std::abs(loaded) + std::abs(flowed) + largest_stress() + per_velocity * 0.01 * largest_velocity();
      worst = std::max(worst, (std::abs(after_.stress[i] - before_.stress[i] + flowed - loaded) - kTiny) / size);
    }
    return worst;
  }

  void expect_flow_law() const {
    for (int i = 0; i <= cells(); ++i) {
      const double s = std::abs(after_.stress[i]);
      const double growth = after_.strain_growth[i];
      ASSERT_GE(growth, 0.0);
      const double limit = flow_stress(soft_, before_.strain[i] + growth, step_.pressure, T(i)) / kSqrt3;
      const double tolerance = limit * limit_tolerance(soft_, step_.pressure, T(i)) + kTiny;
      ASSERT_LE(s, limit + tolerance) << "vertex " << i << " T " << T(i) << " growth " << growth;
      if (growth > 1e-15 * (1.0 + before_.strain[i])) {
        ASSERT_GE(s, limit - tolerance) << "vertex " << i << " T " << T(i) << " growth " << growth;
      }
    }
    const double s_0 = std::abs(after_.stress[0]);
    ASSERT_LE(s_0, step_.coulomb * (1 + 1e-15));
    if (answer_.interface_slip != 0.0) {
      ASSERT_EQ(s_0, step_.coulomb);
      ASSERT_GE(answer_.interface_slip * after_.stress[0], 0.0);
    }
  }

  // Residual of the energy balance of a step: work done on the layer = gain of kinetic and elastic energy + plastic
  // work + numerical dissipation of backward Euler, which is never negative.
  double energy_fault() const {
    double balance = step_.dt * after_.stress[cells()] * step_.jump - step_.dt * after_.stress[0] * velocity(-1);
    double size = std::abs(balance);
    const auto book = [&](double energy) {
      balance -= energy;
      size += std::abs(energy);
    };
    for (int c = 0; c < cells(); ++c) {
      const double v = after_.velocity[c], old = before_.velocity[c];
      book(0.5 * mass(c) * (v * v - old * old));
      book(0.5 * mass(c) * (v - old) * (v - old));
      size += mass(c) * old * old + momentum_size(c) * (largest_velocity() + kLeastVelocity);
    }
    for (int i = 0; i <= cells(); ++i) {
      const double softness = step_.grid->weight[i] / soft_.shear_modulus;
      const double s = after_.stress[i], old = before_.stress[i];
      book(0.5 * softness * (s * s - old * old));
      book(0.5 * softness * (s - old) * (s - old));
      book(kSqrt3 * step_.grid->weight[i] * std::abs(s) * after_.strain_growth[i]);
      size += softness * old * old;
    }
    return std::abs(balance) / size;
  }

  const WaveStep& step() const { return step_; }
  const WaveAnswer& answer() const { return answer_; }
  const WaveFields& fields() const { return after_; }

 private:
  Material soft_;
  WaveStep step_;
  WaveFields before_, after_;
  WaveAnswer answer_;
};

class PhysicsWaves : public ::testing::TestWithParam<bool> {};

TEST_P(PhysicsWaves, EveryEquationHoldsForRandomScenesAndInputs) {
  const bool extreme = GetParam();
  Draw draw(41 + (extreme ? 1 : 0));
  double momentum = 0.0, kinematic = 0.0, energy = 0.0;
  int steps = 0, flowing = 0, slipping = 0, melting = 0, guarded = 0, failed = 0, reversed = 0, most = 0;
  long iterations = 0;
  for (int scene = 0; scene < 220; ++scene) {
    Rig rig(random_inertia_options(draw, extreme));
    for (int n = 0; n < 25; ++n) {
      random_inputs(draw, rig, extreme);
      const double dt = random_dt(draw, extreme);
      rig.operators = rig.model.operators(dt);
      std::deque<Step> solved;  // not a vector, which would move a Step: a Step holds pointers into itself
      for (int l = 0; l < kLanes; ++l) solved.emplace_back(rig, l);
      rig.step(dt);
      for (int l = 0; l < kLanes; ++l) {
        if (rig.inputs.pressure[l] <= 0.0) continue;
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(n) + ", lane " + std::to_string(l));
        Step& step = solved[static_cast<std::size_t>(l)];
        step.solve();
        if (!step.answer().found) {  // inputs far outside physics: the outcome is "failed", and the state is kept
          ASSERT_TRUE(rig.outputs.outcome[l] & kFailed);
          for (int i = 0; i <= step.cells(); ++i) ASSERT_EQ(stress_at(rig, i, l), step.stress_before(i));
          ++failed;
          continue;
        }
        momentum = std::max(momentum, step.momentum_fault());
        kinematic = std::max(kinematic, step.kinematic_fault());
        energy = std::max(energy, step.energy_fault());
        ASSERT_LE(step.momentum_fault(), extreme ? 1e-6 : 1e-8);
        ASSERT_LE(step.kinematic_fault(), 1e-12);
        ASSERT_LE(step.energy_fault(), 1e-9);
        step.expect_flow_law();
        // The step of the whole tile must give this lane the same results as the step of the lane alone.
        ASSERT_EQ(rig.outputs.shear_stress[l], step.fields().stress[0]);
        ASSERT_EQ(rig.outputs.friction_heat[l], step.answer().flux * dt);
        ASSERT_NEAR(step.answer().flux,
                    step.step().heat_share * std::max(0.0, step.fields().stress[0] * step.step().jump),
                    1e-9 * step.answer().flux + 1e-30);
        for (int i = 0; i <= step.cells(); ++i) {
          if (rig.model.options().soft.melting_curve == MeltingCurve::kConstant) {
            ASSERT_LT(rig.T(i, l), rig.model.options().soft.melting_temperature);
          }
          ASSERT_GE(rig.ep(i, l), step.fields().strain[i]);
          ASSERT_EQ(stress_at(rig, i, l), step.fields().stress[i]);
        }
        if (::testing::Test::HasFatalFailure()) return;
        ++steps;
        iterations += step.answer().iterations;
        most = std::max(most, step.answer().guarded ? 0 : step.answer().iterations);
        guarded += step.answer().guarded;
        flowing += rig.outputs.regime[l] == Regime::kTresca;
        slipping += rig.outputs.regime[l] == Regime::kCoulomb;
        melting += rig.outputs.regime[l] == Regime::kMelting;
        const auto [low, high] = std::minmax_element(step.fields().stress, step.fields().stress + step.cells() + 1);
        reversed += *low * *high < 0.0;
      }
    }
  }
  std::printf(
      "%d node-steps: tresca %d, coulomb %d, melting %d, stress of both signs %d; %.2f Newton steps each, at most %d, "
      "guarded %d, failed %d; worst momentum %.1e, kinematics %.1e, energy %.1e\n",
      steps, flowing, slipping, melting, reversed, static_cast<double>(iterations) / steps, most, guarded, failed,
      momentum, kinematic, energy);
  EXPECT_GT(std::min({flowing, slipping, melting, reversed}), 100);
  EXPECT_LT(guarded, steps / 500);
  EXPECT_LE(failed, extreme ? steps / 5000 : 0);
}

// A step with inertia is solved by Newton's method and, if this fails, by a bracketing search. Both must find the same
// answer.
TEST_P(PhysicsWaves, TheSearchThatCannotFailFindsTheSameAnswer) {
  const bool extreme = GetParam();
  Draw draw(43 + (extreme ? 1 : 0));
  int compared = 0, heated = 0;
  double worst = 0.0;
  for (int scene = 0; scene < 15; ++scene) {
    Rig rig(random_inertia_options(draw, extreme));
    for (int n = 0; n < 12; ++n) {
      random_inputs(draw, rig, extreme);
      rig.operators = rig.model.operators(random_dt(draw, extreme));
      for (int l = 0; l < kLanes; l += 3) {
        if (rig.inputs.pressure[l] <= 0.0) continue;
        SCOPED_TRACE("scene " + std::to_string(scene) + ", step " + std::to_string(n) + ", lane " + std::to_string(l));
        Step fast(rig, l), sure(rig, l);
        fast.solve();
        sure.solve(0);
        ASSERT_TRUE(sure.answer().guarded);
        const double size = fast.largest_stress() + kLeastStress;
        for (int i = 0; i <= fast.cells(); ++i) {
          const double apart = std::abs(fast.fields().stress[i] - sure.fields().stress[i]) / size;
          worst = std::max(worst, apart);
          ASSERT_LE(apart, 1e-7) << "vertex " << i;
        }
        ASSERT_NEAR(fast.T(0), sure.T(0), 1e-9);
        ++compared;
        heated += fast.answer().flux > 0.0;
      }
      rig.step(rig.operators->dt());
    }
  }
  std::printf("%d node-steps, %d heated: stresses at most %.1e apart\n", compared, heated, worst);
  EXPECT_GT(heated, 80);
}

INSTANTIATE_TEST_SUITE_P(, PhysicsWaves, ::testing::Values(false, true),
                         [](const auto& test) { return test.param ? "Extreme" : "Usual"; });

}  // namespace
}  // namespace shearbus::testing
