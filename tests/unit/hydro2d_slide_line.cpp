// Slide lines of the two-dimensional hydrocode: conservation, meshes that do not match, opening and closing, curved
// lines.
#include <gtest/gtest.h>

#include <numbers>

#include "hydro_stub/simple_laws.hpp"
#include "hydro_stub/verification/exact.hpp"
#include "tests/support/hydro2d.hpp"
#include "tests/support/hydro2d_plates.hpp"
#include "tests/support/hydro_laws.hpp"

namespace shearbus {
namespace {

using namespace test;  // NOLINT(google-build-using-namespace)
using lagrange::InterfaceWeights;
using lagrange::Ledger;
using lagrange::surface;

constexpr Symmetry kBoth[] = {Symmetry::kPlane, Symmetry::kAxisymmetric};

// Two blocks in contact along the line y = slope * x. The upper block is soft. The numbers of zones along the line
// (`soft_across`, `hard_across`) may differ.
Bodies two_blocks(Symmetry symmetry, int soft_across, int hard_across, double slope, double length = 4e-3) {
  Mesh mesh(symmetry);
  const auto block = [&](int nx, double from, double to) {
    mesh.add_block(nx, 4, [=](int i, int j) {
      const double x = length * i / nx;
      return Vec2{x, (from + (to - from) * j / 4.0) * length + slope * x};
    });
  };
  block(soft_across, 0.0, 0.5);
  block(hard_across, -0.5, 0.0);
  Bodies bodies(mesh);
  bodies.materials.push_back({.eos = Eos(aluminium_6061()), .strength = constant_yield(2703.0, 27.6e9, 290e6)});
  bodies.materials.push_back({.eos = Eos(steel_304()), .strength = constant_yield(7900.0, 77e9, 340e6)});
  fill(bodies, 0, 2703.0, 0.0, {});
  fill(bodies, 1, 7900.0, 0.0, {});
  bodies.slide_lines.push_back(
      {surface(bodies.mesh.blocks()[0], Side::kBottom), surface(bodies.mesh.blocks()[1], Side::kTop)});
  return bodies;
}

TEST(Hydro2dSlideLine, BothSidesOfEveryWeightCancel) {
  for (const Symmetry symmetry : kBoth) {
    const Bodies bodies = two_blocks(symmetry, 7, 5, 0.4);
    InterfaceWeights weights(symmetry, bodies.slide_lines);
    weights.find(bodies.mesh.places());
    double total = 0.0;
    for (int i = 0; i < weights.size(); ++i) {
      Vec2 push;
      double rub = 0.0, soft = 0.0, hard = 0.0;
      for (const auto& w : weights.push(i)) push += w.weight;
      for (const auto& w : weights.rub(i)) rub += w.weight;
      for (const auto& z : weights.soft_zones(i)) soft += z.share;
      for (const auto& z : weights.hard_zones(i)) hard += z.share;
      EXPECT_NEAR(norm(push), 0.0, 1e-15 * 4e-3);
      EXPECT_NEAR(rub / weights.area(i), 1.0, 1e-13);
      EXPECT_NEAR(soft, 1.0, 1e-13);
      EXPECT_NEAR(hard, 1.0, 1e-13);
      EXPECT_NEAR(weights.gap(i), 0.0, 1e-18);
      total += weights.area(i);
    }
    const double length = 4e-3 * std::sqrt(1.16);
    EXPECT_NEAR(total / (length * (symmetry == Symmetry::kPlane ? 1.0 : 2e-3)), 1.0, 1e-12);
  }
}

// Both bodies and their outer faces are under the same pressure, and no nodes match across the line. Nothing may move.
TEST(Hydro2dSlideLine, PatchOfUniformPressureStaysAtRest) {
  constexpr double kPressure = 5e9;
  for (const Symmetry symmetry : kBoth) {
    for (const double slope : {0.0, 0.4}) {
      Bodies bodies = two_blocks(symmetry, 7, 5, slope);
      const lagrange::Block soft = bodies.mesh.blocks()[0], hard = bodies.mesh.blocks()[1];
      fill(bodies, 0, hydro::density_at(aluminium_6061(), kPressure), 0.0, {});
      fill(bodies, 1, hydro::density_at(steel_304(), kPressure), 0.0, {});
      for (const Side side : {Side::kLeft, Side::kRight, Side::kTop})
        bodies.loads.push_back({soft.side(side), kPressure});
      for (const Side side : {Side::kLeft, Side::kRight, Side::kBottom})
        bodies.loads.push_back({hard.side(side), kPressure});
      Cycle cycle(std::move(bodies));
      for (int i = 0; i < 200; ++i) cycle.advance(1.0);
      double fastest = 0.0;
      for (const Vec2 v : cycle.state().velocity) fastest = std::max(fastest, norm(v));
      EXPECT_LT(fastest, 1e-8);  // largest speed of a node [m/s]; the sound speed is about 6 km/s
      for (int z = 0; z < cycle.mesh().num_zones(); ++z) EXPECT_NEAR(cycle.state().pressure[z] / kPressure, 1.0, 1e-10);
      for (int i = 0; i < cycle.contact().size(); ++i)
        EXPECT_NEAR(cycle.contact().inputs().pressure[i] / kPressure, 1.0, 1e-9);
    }
  }
}

// Impact, sliding and separation with free slip, with constant friction and with bonded bodies: the sums of momentum
// and of energy (with friction heat) do not change.
TEST(Hydro2dSlideLine, MomentumAndEnergyCloseToRoundingWithEveryLaw) {
  for (const Symmetry symmetry : kBoth) {
    for (const double limit : {kFreeSlip, 100e6, kBonded}) {
      Bodies bodies = two_blocks(symmetry, 7, 5, symmetry == Symmetry::kPlane ? 0.3 : 0.0);
      const bool axial = symmetry == Symmetry::kAxisymmetric;
      fill(bodies, 0, 2703.0, 0.0, {axial ? 0.0 : 100.0, -200.0});
      if (axial) {
        for (const lagrange::Block& b : bodies.mesh.blocks())
          bodies.walls.push_back({b.side(Side::kLeft), {1.0, 0.0}, 0.0});
        const lagrange::Block& b = bodies.mesh.blocks()[0];
        for (int n = b.first_node; n < b.first_node + b.num_nodes(); ++n) {
          // the velocity grows with x, so the soft block slides
          bodies.velocity[n].x = 5e4 * bodies.mesh.places()[n].x;
        }
      }
      ConstantFrictionLaw law(limit);
      Cycle cycle(std::move(bodies), &law);
      const Ledger start = cycle.ledger();
      cycle.run_to(3e-6);
      const Ledger end = cycle.ledger();
      EXPECT_NEAR((end.total_energy() - end.work_given) / start.total_energy(), 1.0, 1e-13);
      EXPECT_NEAR((end.momentum.y - end.impulse_given.y) / start.momentum.y, 1.0, 1e-13);
      if (!axial) {
        EXPECT_NEAR((end.momentum.x - end.impulse_given.x) / start.momentum.x, 1.0, 1e-12);
      }
      EXPECT_GT(end.closing_heat, 0.0);
      if (limit == 100e6) {
        EXPECT_GT(end.friction_heat, 1e-4 * start.kinetic);
      }
      if (limit == kFreeSlip) {
        EXPECT_EQ(end.friction_heat, 0.0);
      }
    }
  }
}

// A host may ask for a state at an exact time. The last steps before this time must not become much shorter than usual:
// the slide line closes a gap within one step, at the velocity gap/dt, which would then be too high.
TEST(Hydro2dSlideLine, TimesThatMustBeMetCostNoSliverOfAStep) {
  Bodies bodies = two_blocks(Symmetry::kPlane, 7, 5, 0.0);
  fill(bodies, 0, 2703.0, 0.0, {30.0, -100.0});
  Cycle cycle(std::move(bodies));
  for (int i = 0; i < 20; ++i) cycle.advance(1.0);
  const double usual = cycle.contact().inputs().dt;
  for (int stop = 0; stop < 40; ++stop) {
    const double until = cycle.state().time + usual * (2.0 + 0.02 * stop);
    while (cycle.state().time < until) {
      cycle.advance(until);
      ASSERT_GT(cycle.contact().inputs().dt, 0.4 * usual);
    }
    ASSERT_EQ(cycle.state().time, until);
  }
}

TEST(Hydro2dSlideLine, BodiesThatFlyApartDoNotKnowEachOther) {
  Bodies bodies = two_blocks(Symmetry::kPlane, 7, 5, 0.0);
  fill(bodies, 0, 2703.0, 0.0, {30.0, 50.0});
  ConstantFrictionLaw law(100e6);
  Cycle cycle(std::move(bodies), &law);
  for (int i = 0; i < 20; ++i) {
    cycle.advance(1.0);
    for (const double p : cycle.contact().inputs().pressure) ASSERT_EQ(p, 0.0);
  }
}

// Friction stronger than the soft zones makes these zones flow in shear. The plastic strain rate that the contact
// passes to the interface law must integrate to the plastic strain of the zone, for any angle of the slide line.
TEST(Hydro2dSlideLine, TheLawIsToldThePlasticShearOfTheSoftZones) {
  for (const double angle : {0.0, 0.7}) {
    Plates p;
    p.length = 1e-3;
    p.width = 50e-6;
    p.angle = angle;
    Bodies bodies = plates(p);
    bodies.materials[0].strength->yield_strength = 60e6;
    ConstantFrictionLaw law(50e6);
    Cycle cycle(std::move(bodies), &law);
    const auto middle = static_cast<std::size_t>(cycle.contact().size() / 2);
    double sum = 0.0, time = 0.0;
    for (int n = 0; n < 40; ++n) {
      cycle.advance(1.0);
      const hydro::InterfaceInputs& in = cycle.contact().inputs();
      ASSERT_GE(in.soft_plastic_strain_rate[middle], 0.0);
      const double begin = in.time - in.dt;
      sum += in.soft_plastic_strain_rate[middle] * (begin - time);  // the contact passes the rate of the previous step
      time = begin;
    }
    const double strain = cycle.contact().inputs().zone_plastic_strain[middle];
    EXPECT_GT(strain, 1e-3);
    EXPECT_LE(sum, strain * (1.0 + 1e-12));
    EXPECT_GT(sum, 0.9 * strain) << "angle " << angle;
  }
}

// An interface law whose first answer tears neighbouring nodes apart; every later answer is free slip.
class TearsOnce : public hydro::FreeSlipLaw {
 public:
  explicit TearsOnce(bool tears) : tears_(tears) {}
  void advance(const hydro::InterfaceInputs& inputs, hydro::InterfaceAnswer& answer) override {
    FreeSlipLaw::advance(inputs, answer);
    asked_for.push_back(inputs.dt);
    for (std::size_t i = 0; tears_ && i < answer.shear_stress.size(); ++i)
      answer.shear_stress[i] = i % 2 == 0 ? 2e13 : -2e13;
    tears_ = false;
  }
  void take_back() override { ++taken_back; }

  std::vector<double> asked_for;  // dt of each call of the law [s]
  int taken_back = 0;

 private:
  bool tears_;
};

// The cycle rejects a step that becomes invalid by the answer of the interface law: it calls `take_back` on the law and
// repeats the step with a shorter dt. The result must equal that of a run that began with the shorter dt.
TEST(Hydro2dSlideLine, AStepThatTheLawsAnswerSpoilsIsTakenBackFromTheLawToo) {
  Plates p;
  p.length = 1e-3;
  p.width = 50e-6;
  Bodies bodies = plates(p);
  Bodies shorter = bodies;
  bodies.time_step.first = 1e-9;
  shorter.time_step.first = 0.25e-9;
  TearsOnce law(true), calm(false);
  Cycle cycle(std::move(bodies), &law);
  Cycle other(std::move(shorter), &calm);
  cycle.advance(1.0);
  other.advance(1.0);
  EXPECT_EQ(cycle.rejected_steps(), 1u);
  EXPECT_EQ(law.taken_back, 1);
  EXPECT_EQ(law.asked_for, (std::vector<double>{1e-9, 0.25e-9}));
  EXPECT_EQ(calm.taken_back, 0);
  const lagrange::State &a = cycle.state(), &b = other.state();
  for (std::size_t n = 0; n < a.velocity.size(); ++n) {
    ASSERT_EQ(a.velocity[n].x, b.velocity[n].x);
    ASSERT_EQ(a.velocity[n].y, b.velocity[n].y);
    ASSERT_EQ(a.position[n].x, b.position[n].x);
  }
  EXPECT_EQ(a.energy, b.energy);
  EXPECT_EQ(a.deviator_xy, b.deviator_xy);
}

// Two surfaces approach each other from a distance of a fifth of a zone. The contact closes at the time distance /
// speed, and the contact pressure is 0 before.
TEST(Hydro2dSlideLine, AGapClosesWhenTheSurfacesMeet) {
  Bodies bodies = two_blocks(Symmetry::kPlane, 7, 5, 0.0);
  Mesh mesh(Symmetry::kPlane);
  constexpr double kGap = 1e-4;
  constexpr double kSpeed = 200.0;
  mesh.add_block(7, 4, rectangle(7, 4, {0.0, kGap}, {4e-3, 2e-3 + kGap}));
  mesh.add_block(5, 4, rectangle(5, 4, {0.0, -2e-3}, {4e-3, 0.0}));
  bodies.mesh = mesh;
  fill(bodies, 0, 2703.0, 0.0, {0.0, -kSpeed});
  Cycle cycle(std::move(bodies));
  while (cycle.contact().inputs().pressure.empty() || cycle.contact().inputs().pressure[3] == 0.0) cycle.advance(1.0);
  EXPECT_NEAR(cycle.state().time / (kGap / kSpeed), 1.0, 0.25);
  for (int i = 0; i < 100; ++i) {
    cycle.advance(1.0);
    for (int k = 0; k < cycle.contact().size(); ++k) ASSERT_GT(cycle.contact().weights().gap(k), -0.02 * 5e-4);
  }
}

// A disc rotates in a ring without friction. The contour of the disc is a polygon of 64 sides, that of the ring has 48
// sides: their corners must not interlock.
TEST(Hydro2dSlideLine, ADiscTurnsFreelyInARing) {
  const auto angular = [](const Cycle& cycle, int block) {
    const lagrange::Block& b = cycle.mesh().blocks()[block];
    double sum = 0.0;
    for (int n = b.first_node; n < b.first_node + b.num_nodes(); ++n) {
      sum += cycle.state().node_mass[n] * cross(cycle.state().position[n], cycle.state().velocity[n]);
    }
    return sum;
  };
  Mesh mesh(Symmetry::kPlane);
  const auto ring = [&](int around, double inner, double outer) {
    mesh.add_block(
        around, 3,
        [=](int i, int j) {
          const double angle = 2.0 * std::numbers::pi * i / around;
          const double r = outer + (inner - outer) * j / 3.0;  // rows run inward, so that zones are counter-clockwise
          return Vec2{r * std::cos(angle), r * std::sin(angle)};
        },
        true);
  };
  ring(64, 4e-3, 8e-3);
  ring(48, 8e-3, 12e-3);
  Bodies bodies(mesh);
  bodies.materials.push_back({.eos = Eos(aluminium_6061()), .strength = constant_yield(2703.0, 27.6e9, 290e6)});
  bodies.materials.push_back({.eos = Eos(steel_304()), .strength = constant_yield(7900.0, 77e9, 340e6)});
  fill(bodies, 0, 2703.0, 0.0, {});
  fill(bodies, 1, 7900.0, 0.0, {});
  constexpr double kTurning = 5e3;  // angular velocity [1/s]: 40 m/s at the slide line
  const lagrange::Block soft = bodies.mesh.blocks()[0];
  for (int n = soft.first_node; n < soft.first_node + soft.num_nodes(); ++n) {
    bodies.velocity[n] = kTurning * lagrange::left_of(bodies.mesh.places()[n]);
  }
  bodies.slide_lines.push_back({surface(soft, Side::kBottom), surface(bodies.mesh.blocks()[1], Side::kTop)});
  Cycle cycle(std::move(bodies));
  const double start = angular(cycle, 0);
  cycle.run_to(20e-6);  // the disc turns by 0.1 rad, a little more than one side of its polygon
  std::printf("angular momentum kept by the disc: %.6f, passed to the ring: %.2e\n", angular(cycle, 0) / start,
              angular(cycle, 1) / start);
  EXPECT_NEAR(angular(cycle, 0) / start, 1.0, 0.01);
}

}  // namespace
}  // namespace shearbus
