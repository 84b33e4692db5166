// One stage of a step of a layer with inertia, solved for one lane alone, and the residuals of its equations.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/waves.hpp"

namespace shearbus::testing {

inline constexpr double kTiny = 1e-280;
// Residuals are relative to the largest stress plus kLeastStress, or the largest velocity plus kLeastVelocity, because
// a layer close to melting may carry almost no stress.
inline constexpr double kLeastStress = 1e6;  // added to the largest stress, to which residuals are relative  [Pa]
inline constexpr double kLeastVelocity =
    1e-20;  // added to the largest velocity, to which residuals are relative  [m/s]

// Relative tolerance of the flow stress of a vertex: 1e-9, and the change that an ulp of the temperature causes.
inline double limit_tolerance(const Material& soft, double pressure, double T) {
  const Softening soften = softening(soft, pressure, T);
  if (soften.g <= 0.0) return 1.0;
  return 1e-9 + 4e-16 * T * std::abs(soften.slope) / soften.g;
}

// One step of backward Euler of one lane: a whole step, or a stage of SDIRK2.
class WaveStage {
 public:
  // A whole step, or with another `heat` the first stage, from the state of the rig.
  WaveStage(const Rig& rig, int lane) : WaveStage(rig, lane, rig.operators->heat()) {}
  WaveStage(const Rig& rig, int lane, const HeatOperator& heat) : WaveStage(rig, lane, heat, WaveFields{}) {
    fill_fields(rig, lane, heat, before_);
    after_ = before_;
  }
  // A stage from any fields.
  WaveStage(const Rig& rig, int lane, const HeatOperator& heat, const WaveFields& start)
      : rig_(rig),
        soft_(at_pressure(rig.model.options().soft, rig.inputs.pressure[lane])),
        step_(lane_waves(rig, lane, heat, soft_)),
        before_(start),
        after_(start) {}
  WaveStage(const WaveStage&) = delete;
  WaveStage& operator=(const WaveStage&) = delete;

  void solve(int newton_steps = kWaveNewtonSteps) { answer_ = search_waves(rig_, step_, newton_steps, after_); }

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

  // The growth of the strain is known to an ulp of it; times the inverse of a tolerance that is part of a scale.
  double ulp_of_strain(int i) const { return 2.2e-16 * before_.strain[i]; }

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

  // Scales of the heat, and of stress and plastic strain of vertex i. Times 1e-8 they are above what Newton's method leaves,
  // which ends with the stresses balanced to 1e-11 and the velocities known to 1e-10 of the largest, or to 1e-7 m/s where
  // close to melting all stresses vanish.
  double stress_size(int i) const {
    const double per_velocity = soft_.shear_modulus * step_.dt / step_.grid->weight[i];
    return largest_stress() + kLeastStress + 1e-6 * per_velocity * largest_velocity();
  }
  double strain_size(int i) const {
    const double per_velocity = step_.dt / (kSqrt3 * step_.grid->weight[i]);
    return before_.strain[i] + 1e-6 + stress_size(i) / (kSqrt3 * soft_.shear_modulus) +
           per_velocity * (std::abs(velocity(i)) + 0.01 * (largest_velocity() + 1e3));
  }
  double heat_size() const { return stress_size(0) * std::abs(step_.jump) * step_.dt; }

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
      const double rounding = 1e12 * kSqrt3 * soft_.shear_modulus * ulp_of_strain(i);
      const double size =
          std::abs(loaded) + std::abs(flowed) + largest_stress() + per_velocity * 0.01 * largest_velocity() + rounding;
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
      size += softness * old * old + 1e9 * kSqrt3 * step_.grid->weight[i] * std::abs(s) * ulp_of_strain(i);
    }
    return std::abs(balance) / size;
  }

  const LaneWaves& step() const { return step_; }
  const LaneAnswer& answer() const { return answer_; }
  const WaveFields& before() const { return before_; }
  const WaveFields& fields() const { return after_; }
  const Material& soft() const { return soft_; }

 private:
  const Rig& rig_;
  Material soft_;
  LaneWaves step_;
  WaveFields before_, after_;
  LaneAnswer answer_;
};

}  // namespace shearbus::testing
