// Tests the energy ledger (METHODS.md, "Energy ledger"): some balances must close to rounding, the residuals of the
// others must stay below known bounds.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "tests/support/random_physics.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::testing {
namespace {

// Steps the rig and returns the energy ledger of the step.
TileLedger booked_step(Rig& rig, double dt) {
  rig.step(dt);  // swaps the states: the old state is now in `trial`
  TileLedger ledger;
  rig.model.record_energy(*rig.operators, rig.inputs, rig.outputs, rig.trial.data(), rig.committed.data(), ledger);
  return ledger;
}

double sum_of_sizes(TileLedger& ledger, int lane) {
  double sum = 0.0;
  for (LedgerTerm t : {LedgerTerm::kWork, LedgerTerm::kHeatToSoft, LedgerTerm::kHeatToHard, LedgerTerm::kPlasticWork,
                       LedgerTerm::kElastic}) {
    sum += std::abs(ledger(t, lane));
  }
  return sum;
}

class PhysicsLedger : public ::testing::TestWithParam<Strategy> {};

// Every scheme conserves heat in any state: the heat released in a step equals the growth of the stored heat, to
// rounding relative to the stored heat.
TEST_P(PhysicsLedger, HeatReleasedIsHeatStored) {
  Draw draw(41);
  for (int scene = 0; scene < 80; ++scene) {
    ModelOptions options = random_options(draw, GetParam(), scene % 2 == 1);
    Draw aside = draw;
    draw_work_heat(aside, options);
    Rig rig(options);
    for (int step = 0; step < 15; ++step) {
      random_inputs(draw, rig, scene % 2 == 1);
      double heat_before[kLanes];
      for (int l = 0; l < kLanes; ++l) heat_before[l] = rig.stored_heat(0.0, l);
      TileLedger ledger = booked_step(rig, random_dt(draw, scene % 2 == 1));
      for (int l = 0; l < kLanes; ++l) {
        const double size = heat_before[l] + ledger(LedgerTerm::kHeatToSoft, l) + ledger(LedgerTerm::kHeatToHard, l);
        ASSERT_NEAR(ledger(LedgerTerm::kHeatResidual, l), 0.0, 1e-12 * size) << scene << " " << step;
        if (rig.model.options().hard_grid) {
          ASSERT_NEAR(ledger(LedgerTerm::kHeatToSoft, l) + ledger(LedgerTerm::kHeatToHard, l),
                      rig.outputs.friction_heat[l], 1e-12 * size);
        } else {
          ASSERT_EQ(ledger(LedgerTerm::kStoredHard, l), 0.0);
          ASSERT_NEAR(ledger(LedgerTerm::kHeatToSoft, l) * (1.0 / rig.conducted_share() - 1.0),
                      ledger(LedgerTerm::kHeatToHard, l), 1e-12 * size);
        }
      }
    }
  }
}
INSTANTIATE_TEST_SUITE_P(, PhysicsLedger, support::both<Strategy>(), support::name_of_strategy);

// Absolute tolerance of the energies [J/m2]. The stress of a molten interface is almost 0 and has no accurate digit.
constexpr double kNothing = 1e-200;

// Force-driven step: the work of the interface becomes friction heat and, in a flowing layer, plastic work. If slip
// stops or starts within the step, the scheme cuts off the slip velocity [v] at 0, which leaves a residual of at most
// |s| |[V]new - [V]old| dt / 2. A slip that lasts the whole step, next to a layer that does not flow, leaves no
// residual.
TEST(PhysicsLedgerOfForces, ClosesButForTheClipOfStoppingJumps) {
  Draw draw(42);
  int exact = 0, clipped = 0;
  for (int scene = 0; scene < 120; ++scene) {
    ModelOptions options = random_options(draw, Strategy::kForceDriven, false);
    Draw aside = draw;
    draw_work_heat(aside, options);
    Rig rig(options);
    for (int step = 0; step < 25; ++step) {
      random_inputs(draw, rig, false);
      const double dt = random_dt(draw, false);
      TileLedger ledger = booked_step(rig, dt);
      for (int l = 0; l < kLanes; ++l) {
        if (rig.outputs.outcome[l] & kSubstepped) continue;
        const TileInputs& in = rig.inputs;
        const double s = std::abs(rig.outputs.shear_stress[l]);
        const double driven =
            dt * (std::abs(in.stress_soft[l]) / in.mass_soft[l] + std::abs(in.stress_hard[l]) / in.mass_hard[l]);
        // Tolerance [J/m2] for rounding: jumps are computed as differences of velocities, and flow as a difference of
        // strains.
        double grain = kNothing + 1e-12 * s * (std::abs(in.velocity_jump[l]) + driven) * dt;
        if (rig.model.options().plastic_layer) grain += 1e-8 * s * (rig.plastic_slip(l) + driven * dt);
        const double size = sum_of_sizes(ledger, l);
        const double change = std::abs(rig.outputs.velocity_jump_new[l] - in.velocity_jump[l]);
        const double residual = std::abs(ledger(LedgerTerm::kEnergyResidual, l));
        const double heat_noise = rig.model.options().hard_grid ? 1e-12 * rig.stored_heat(0.0, l) : 0.0;
        ASSERT_LE(residual, 0.5 * s * change * dt + 1e-12 * size + grain + heat_noise) << scene << " " << step;
        const bool slips = rig.outputs.regime[l] == Regime::kCoulomb && !rig.model.options().plastic_layer &&
                           rig.outputs.sliding_velocity[l] != 0.0;
        if (slips) {
          ASSERT_LE(residual, 1e-12 * size + grain + heat_noise) << scene << " " << step;
          ++exact;
        }
        clipped += residual > 1e-6 * size;
      }
    }
  }
  EXPECT_GT(exact, 200);
  EXPECT_GT(clipped, 20);  // the cut-off does occur, so its bound is tested
}

// Velocity-driven step: the scheme turns all work of the jump into heat, elastic work too. The residual is therefore
// minus the elastic energy h s^2 / (2 G0) of the layer, 0.03 % of the work in the first microsecond of the paper's
// case. The work is the sum of plastic work, elastic energy and the loss h (ds)^2 / (2 G0) per step of backward Euler.
TEST(PhysicsLedgerOfJumps, ElasticWorkTakenForHeatIsTheWholeResidual) {
  Rig rig(graded(paper_options()), 1);
  rig.set_all(100.0, 11.2e9);
  const double spring = 0.5 * rig.model.options().grid.thickness / rig.model.options().soft.shear_modulus;
  double work = 0.0, plastic = 0.0, residual = 0.0, lost = 0.0, s_old = 0.0;
  for (int n = 0; n < 1000; ++n) {
    TileLedger ledger = booked_step(rig, 1e-9);
    work += ledger(LedgerTerm::kWork, 0);
    plastic += ledger(LedgerTerm::kPlasticWork, 0);
    residual += ledger(LedgerTerm::kEnergyResidual, 0);
    lost += spring * (rig.stress() - s_old) * (rig.stress() - s_old);
    s_old = rig.stress();
    ASSERT_NEAR(residual, -spring * s_old * s_old, 1e-12 * work) << n;
  }
  const double elastic = spring * s_old * s_old;
  std::printf("paper's case, 1 us: work %.6g J/m2, plastic %.6g, elastic %.4g, lost %.4g, residual %.4g\n", work,
              plastic, elastic, lost, residual);
  EXPECT_NEAR(plastic + elastic + lost, work, 1e-9 * work);
  EXPECT_LT(-residual, 1e-3 * work);
  EXPECT_LT(lost, 1e-3 * work);
}

// With plastic-work heating (Taylor-Quinney factor 0.9) a tenth of the plastic work stays in the metal as cold work.
// The energy residual has two causes: the spatial distribution of the heat lags the flow by one step, and elastic work
// heats too. The residual stays below twice the largest elastic energy.
TEST(PhysicsLedgerOfJumps, PlasticHeatingKeepsTheColdShare) {
  ModelOptions options = two_sided(graded(paper_options()));
  options.taylor_quinney_factor = 0.9;
  Rig rig(options, 1);
  rig.set_all(100.0, 11.2e9);
  double work = 0.0, plastic = 0.0, heat = 0.0, residual = 0.0, most_elastic = 0.0;
  for (int n = 0; n < 300; ++n) {
    TileLedger ledger = booked_step(rig, 1e-9);
    work += ledger(LedgerTerm::kWork, 0);
    plastic += ledger(LedgerTerm::kPlasticWork, 0);
    heat += ledger(LedgerTerm::kHeatToSoft, 0) + ledger(LedgerTerm::kHeatToHard, 0);
    residual += ledger(LedgerTerm::kEnergyResidual, 0);
    most_elastic = std::max(most_elastic, 0.5 * 20e-6 * rig.stress() * rig.stress() / 27.6e9);
  }
  EXPECT_NEAR(heat / work, 0.9, 1e-9);
  EXPECT_LT(std::abs(residual), 2.0 * most_elastic);
  EXPECT_NEAR(work - heat - 0.1 * plastic, residual, 2.0 * most_elastic);
}

// The second-order scheme (SDIRK2) heats with the work of the stresses of its two stages, but the ledger computes the
// work with the stress at the end of the step. Apart from the elastic energy, the energy residual is at most
// |change of s| times the imposed slip of the step.
TEST(PhysicsLedgerOfJumps, SecondOrderHeatsWithTheWorkOfItsStages) {
  ModelOptions options = graded(paper_options());
  options.time_integrator = TimeIntegrator::kSdirk2;
  Rig rig(options, 1);
  rig.set_all(100.0, 11.2e9);
  const double spring = 0.5 * rig.model.options().grid.thickness / rig.model.options().soft.shear_modulus;
  double work = 0.0, residual = 0.0, s_old = 0.0;
  for (int n = 0; n < 1000; ++n) {
    const double stored = rig.stored_heat(0.0);
    TileLedger ledger = booked_step(rig, 1e-9);
    const double s = rig.stress();
    const double elastic = spring * (s - s_old) * (s + s_old);
    ASSERT_NEAR(ledger(LedgerTerm::kHeatResidual, 0), 0.0, 1e-12 * stored) << n;
    ASSERT_LE(std::abs(ledger(LedgerTerm::kEnergyResidual, 0) + elastic),
              std::abs(s - s_old) * 100.0 * 1e-9 + 1e-12 * (work + stored))
        << n;
    work += ledger(LedgerTerm::kWork, 0);
    residual += ledger(LedgerTerm::kEnergyResidual, 0) + elastic;
    s_old = s;
  }
  EXPECT_LT(std::abs(residual), 1e-2 * work);
}

// Without a temperature profile the ledger takes the stored heat of an insulated slab from the mode that never decays,
// and the stored heat of a half-space from the heat that has entered.
TEST(PhysicsLedgerOfForces, WithoutAProfileTheHeatIsStillStored) {
  for (const FarBoundary far : {FarBoundary::kInsulated, FarBoundary::kHalfSpace}) {
    ModelOptions options = paper_options(Strategy::kForceDriven);
    options.grid.far_boundary = far;
    options.modes.emplace();
    Rig rig(options, 1);
    rig.set_all(100.0, 11.2e9);
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 10.0;
    const HeatKernel kernel(options.soft, options.grid);
    EXPECT_EQ(kernel.far_face_unfelt(options.modes->longest_time), far == FarBoundary::kHalfSpace);
    for (int n = 0; n < 300; ++n) {
      TileLedger ledger = booked_step(rig, 1e-9);
      const double entered = rig.outputs.friction_heat[0];
      ASSERT_GT(entered, 0.0);
      ASSERT_NEAR(ledger(LedgerTerm::kStoredSoft, 0), entered, 1e-9 * entered) << n;
      ASSERT_NEAR(ledger(LedgerTerm::kEnergyResidual, 0), 0.0, 1e-10 * ledger(LedgerTerm::kWork, 0)) << n;
    }
  }
}

TEST(PhysicsLedgerOfJumps, AnOpenContactDoesNoWork) {
  Rig rig(graded(paper_options()), 1);
  rig.set_all(100.0, -1e9);
  TileLedger ledger = booked_step(rig, 1e-9);
  for (std::size_t t = 0; t < kLedgerTerms; ++t) {
    EXPECT_EQ(ledger.term[t][0], 0.0) << t;
  }
}

}  // namespace
}  // namespace shearbus::testing
