// Two half-spaces that slide on each other, computed by the hydrocode, the message bus and the layer together. The
// reference is the solution of a Volterra equation.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <vector>

#include "hydro_stub/history.hpp"
#include "hydro_stub/problem.hpp"
#include "hydro_stub/scene.hpp"
#include "hydro_stub/shear_column.hpp"
#include "hydro_stub/subgrid_law.hpp"
#include "shearbus_places.hpp"
#include "tests/support/two_half_spaces.hpp"

namespace shearbus {
namespace {

constexpr double kEnd = 300e-9;
const std::vector<double> kTimes = {10e-9, 100e-9, 300e-9};
const test::HalfSpaces kProblem{
    .initial_jump = 100.0, .pressure = 11.2e9, .friction_coefficient = 0.3, .yield_strength = 200e6};

guest::HydroScene shipped_scene() {
  return hydro::load_scene(SHEARBUS_SOURCE_DIR "/hydro_stub/problems/two_half_spaces.toml").scene;
}

test::HalfSpaceState between(const test::HalfSpaceState& a, const test::HalfSpaceState& b, double time) {
  const double part = (time - a.time) / (b.time - a.time);
  return {time, a.stress + part * (b.stress - a.stress), a.jump + part * (b.jump - a.jump),
          a.temperature + part * (b.temperature - a.temperature)};
}

std::vector<test::HalfSpaceState> sample(const std::vector<test::HalfSpaceState>& states) {
  std::vector<test::HalfSpaceState> samples;
  for (const double time : kTimes) {
    std::size_t next = 1;
    while (next + 1 < states.size() && states[next].time < time) ++next;
    samples.push_back(between(states[next - 1], states[next], time));
  }
  return samples;
}

// Runs the scene on an embedded server. A wave crosses a soft zone in `zone_ns` [ns]; a step lasts `dt_ns` [ns].
std::vector<test::HalfSpaceState> run(double zone_ns, double dt_ns) {
  guest::HydroScene scene = shipped_scene();
  guest::ShearColumn& column = *scene.mutable_hydro()->mutable_shear_column();
  const double shipped_zones = column.zones();
  column.set_zones(static_cast<std::uint32_t>(std::lround(shipped_zones / zone_ns)));
  scene.mutable_hydro()->set_cfl(dt_ns / zone_ns);
  scene.mutable_hydro()->set_end_time_s(kEnd);
  const hydro::ColumnProblem problem = hydro::make_problem(scene);
  hydro::SubgridLaw law({scene::to_toml(scene.scene()), "scene"}, hydro::node_ids(problem.columns),
                        problem.initial_temperature);
  hydro::ShearColumn bodies(problem);
  std::vector<test::HalfSpaceState> states;
  for (std::uint64_t step = 0; step < problem.steps; ++step) {
    bodies.advance(law);
    const hydro::InterfaceAnswer& answer = bodies.answer();
    states.push_back(
        {bodies.time(), answer.shear_stress[0], answer.sliding_velocity[0], answer.interface_temperature[0]});
  }
  law.close();
  return sample(states);
}

std::vector<test::HalfSpaceState> reference() {
  return sample(test::solve_two_half_spaces(kProblem, kEnd, 2000));
}

TEST(TwoHalfSpaces, ReferenceGivesTheTableAndHasConverged) {
  const auto coarse = sample(test::solve_two_half_spaces(kProblem, kEnd, 1000));
  const auto fine = reference();
  const test::HalfSpaceState table[] = {
      {10e-9, 195.289e6, 69.472, 362.13}, {100e-9, 185.992e6, 70.925, 492.23}, {300e-9, 176.494e6, 72.410, 624.92}};
  for (std::size_t k = 0; k < kTimes.size(); ++k) {
    EXPECT_NEAR(fine[k].stress, table[k].stress, 1e3);
    EXPECT_NEAR(fine[k].jump, table[k].jump, 1e-3);
    EXPECT_NEAR(fine[k].temperature, table[k].temperature, 1e-2);
    EXPECT_NEAR(fine[k].temperature, coarse[k].temperature, 1e-3);
  }
}

struct Row {
  double zone_ns, dt_ns;
  std::vector<test::HalfSpaceState> states;
};

void print(const Row& row, const std::vector<test::HalfSpaceState>& exact) {
  for (std::size_t k = 0; k < kTimes.size(); ++k) {
    const test::HalfSpaceState& found = row.states[k];
    std::printf("  %7.3f  %6.3f  %5.0f   %9.4f %+8.4f %%   %8.4f %+8.4f %%   %8.3f %+7.3f\n", row.zone_ns, row.dt_ns,
                kTimes[k] * 1e9, found.stress * 1e-6, 100.0 * (found.stress / exact[k].stress - 1.0), found.jump,
                100.0 * (found.jump / exact[k].jump - 1.0), found.temperature,
                found.temperature - exact[k].temperature);
  }
}

TEST(TwoHalfSpaces, WholeLoopConvergesToTheVolterraSolution) {
  const auto exact = reference();
  std::printf("  zone, ns  dt, ns  t, ns   s, MPa                  [V], m/s              T0, K\n");
  // Zones and steps are refined together at Courant number 1. The order of the error is one, because the layer uses
  // backward Euler.
  std::vector<Row> rows;
  for (const double dt : {4.0, 2.0, 1.0, 0.5, 0.25}) {
    rows.push_back({dt, dt, run(dt, dt)});
    print(rows.back(), exact);
  }
  for (std::size_t k = 0; k < kTimes.size(); ++k) {
    const auto error = [&](const Row& row) { return row.states[k].temperature - exact[k].temperature; };
    for (std::size_t r = 1; r < rows.size(); ++r) {
      const double order = std::log2(error(rows[r - 1]) / error(rows[r]));
      std::printf("  order of T0 at %3.0f ns, dt %.2f -> %.2f ns: %.2f\n", kTimes[k] * 1e9, rows[r - 1].dt_ns,
                  rows[r].dt_ns, order);
      if (kTimes[k] > 50e-9) {
        EXPECT_NEAR(order, 1.0, 0.25);
      }
    }
  }
  const auto within = [&](const Row& row, std::size_t k) {
    EXPECT_NEAR(row.states[k].stress / exact[k].stress, 1.0, 2e-3) << "dt " << row.dt_ns << " ns, t " << kTimes[k];
    EXPECT_NEAR(row.states[k].jump / exact[k].jump, 1.0, 2e-3) << "dt " << row.dt_ns << " ns, t " << kTimes[k];
    EXPECT_NEAR(row.states[k].temperature, exact[k].temperature, 1.0) << "dt " << row.dt_ns << " ns, t " << kTimes[k];
  };
  within(rows[2], 1);  // the run with dt = 1 ns
  within(rows[2], 2);
  for (std::size_t k = 0; k < kTimes.size(); ++k) within(rows[4], k);  // the run with dt = 0.25 ns, at all times
}

// At a Courant number below 1 the sudden start makes the velocity jump oscillate at the cut-off frequency of the mesh;
// the oscillation decays as t^(-1/2). Stress and temperature, which depend on all the heat released so far, hardly
// change. At Courant number 1 there is no such oscillation.
TEST(TwoHalfSpaces, BelowUnitCourantNumberStressAndTemperatureHold) {
  const auto exact = reference();
  std::printf("  zone, ns  dt, ns  t, ns   s, MPa                  [V], m/s              T0, K\n");
  for (const double zone : {0.5, 1.0}) {
    const Row row{zone, 0.25, run(zone, 0.25)};
    print(row, exact);
    for (std::size_t k = 0; k < kTimes.size(); ++k) {
      EXPECT_NEAR(row.states[k].stress / exact[k].stress, 1.0, 1e-3);
      EXPECT_NEAR(row.states[k].jump / exact[k].jump, 1.0, 4e-2);
      EXPECT_NEAR(row.states[k].temperature, exact[k].temperature, 1.0);
    }
  }
}

}  // namespace
}  // namespace shearbus
