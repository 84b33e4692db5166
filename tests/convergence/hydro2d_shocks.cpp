// The two-dimensional hydrocode against exact shocks in metals. Each test prints its table.
#include <gtest/gtest.h>

#include "tests/support/hydro2d.hpp"

namespace shearbus {
namespace {

using namespace test;  // NOLINT(google-build-using-namespace)

constexpr MieGrueneisen kPistonMetal = {
    .density = 2790.0, .sound_speed = 5330.0, .s1 = 1.34, .gamma0 = 2.0, .specific_heat = 900.0};
constexpr double kPistonShear = 28.6e9;
constexpr double kPistonYield = 0.26e9;
constexpr double kPistonSpeed = 100.0;

// A strip along which plane waves run, two zones wide between planes of symmetry: along x in the plane, along the axis
// in axisymmetry.
struct Strip {
  static constexpr int kRows = 2;
  Symmetry symmetry;
  bool axial() const { return symmetry == Symmetry::kAxisymmetric; }
  const char* name() const { return axial() ? "axial" : "plane"; }
  Vec2 along(double v) const { return axial() ? Vec2{0.0, v} : Vec2{v, 0.0}; }
  double component(Vec2 v) const { return axial() ? v.y : v.x; }

  void add(Mesh& mesh, int zones, double from, double to) const {
    const double across = kRows * (to - from) / zones;
    if (axial()) {
      mesh.add_block(kRows, zones, rectangle(kRows, zones, {0.0, from}, {across, to}));
    } else {
      mesh.add_block(zones, kRows, rectangle(zones, kRows, {from, 0.0}, {to, across}));
    }
  }
  lagrange::Surface face(const lagrange::Block& b, bool far_end) const {
    const Side start = axial() ? Side::kBottom : Side::kLeft, end = axial() ? Side::kTop : Side::kRight;
    return lagrange::surface(b, far_end ? end : start);
  }
  std::vector<int> start(const lagrange::Block& b) const { return b.side(axial() ? Side::kBottom : Side::kLeft); }
  void guide(Bodies& bodies, const lagrange::Block& b) const {
    const Vec2 across = axial() ? Vec2{1.0, 0.0} : Vec2{0.0, 1.0};
    bodies.walls.push_back({b.side(axial() ? Side::kLeft : Side::kBottom), across, 0.0});
    bodies.walls.push_back({b.side(axial() ? Side::kRight : Side::kTop), across, 0.0});
  }
  int zone(const lagrange::Block& b, int i) const { return axial() ? b.zone(0, i) : b.zone(i, 0); }
  double stress(const Cycle& c, int z) const {
    return c.state().pressure[z] - (axial() ? c.state().deviator_yy[z] : c.state().deviator_xx[z]);
  }
  // Ends of a zone along the strip.
  std::pair<double, double> ends(const Cycle& c, int z) const {
    const int* n = c.mesh().zone_nodes(z);
    return {component(c.state().position[n[0]]), component(c.state().position[n[2]])};
  }
};

// The published solution takes Gamma constant, this equation of state rho Gamma: they part in the fifth digit.
TEST(Hydro2dShock, ExactTwoWavePistonIsThePublishedOne) {
  const TwoWaves exact = two_waves(kPistonMetal, kPistonShear, kPistonYield, kPistonSpeed);
  EXPECT_NEAR(exact.elastic_stress / 0.537995e9, 1.0, 1e-5);
  EXPECT_NEAR(exact.elastic_speed / 6520.66, 1.0, 1e-5);
  EXPECT_NEAR(exact.plastic_speed / 5505.53, 1.0, 5e-5);
  EXPECT_NEAR(exact.stress / 1.618888e9, 1.0, 5e-5);
}

// Mean over the zones whose middle lies between two places.
double mean_stress(const Strip& strip, const Cycle& cycle, int zones, double from, double to) {
  double sum = 0.0;
  int count = 0;
  for (int i = 0; i < zones; ++i) {
    const int z = strip.zone(cycle.mesh().blocks()[0], i);
    const auto [low, high] = strip.ends(cycle, z);
    if (0.5 * (low + high) < from || 0.5 * (low + high) > to) continue;
    sum += strip.stress(cycle, z);
    ++count;
  }
  return sum / count;
}

TEST(Hydro2dShock, ElasticPlasticPiston) {
  const TwoWaves exact = two_waves(kPistonMetal, kPistonShear, kPistonYield, kPistonSpeed);
  constexpr double kTime = 5e-6;
  constexpr double kLength = 50e-3;
  const double plastic_front = exact.plastic_speed * kTime;
  const double elastic_front = exact.elastic_speed * kTime;
  std::printf("symmetry zones   L1 of stress  ratio   behind/GPa   elastic limit/GPa  energy residual\n");
  for (const Symmetry symmetry : {Symmetry::kPlane, Symmetry::kAxisymmetric}) {
    const Strip strip{symmetry};
    double last = 0.0;
    for (const int zones : {100, 200, 400}) {
      Mesh mesh(symmetry);
      strip.add(mesh, zones, 0.0, kLength);
      Bodies bodies(mesh);
      const lagrange::Block& block = bodies.mesh.blocks()[0];
      bodies.materials.push_back(
          {.eos = Eos(kPistonMetal), .strength = constant_yield(kPistonMetal.density, kPistonShear, kPistonYield)});
      fill(bodies, 0, kPistonMetal.density, 0.0, {});
      bodies.walls.push_back({strip.start(block), strip.along(1.0), kPistonSpeed});
      strip.guide(bodies, block);
      Cycle cycle(std::move(bodies));
      const double before = cycle.ledger().total_energy();
      cycle.run_to(kTime);
      double error = 0.0;
      for (int i = 0; i < zones; ++i) {
        const int z = strip.zone(cycle.mesh().blocks()[0], i);
        const auto [low, high] = strip.ends(cycle, z);
        const double x = 0.5 * (low + high);
        const double right = x < plastic_front ? exact.stress : x < elastic_front ? exact.elastic_stress : 0.0;
        error += (high - low) * std::abs(strip.stress(cycle, z) - right);
      }
      error /= exact.stress * elastic_front;
      const double behind = mean_stress(strip, cycle, zones, 0.3 * plastic_front, 0.8 * plastic_front);
      const double gap = elastic_front - plastic_front;
      const double limit = mean_stress(strip, cycle, zones, plastic_front + 0.3 * gap, plastic_front + 0.7 * gap);
      const lagrange::Ledger sum = cycle.ledger();
      const double residual = (sum.total_energy() - before - sum.work_given) / sum.total_energy();
      std::printf("%s    %5d   %.6f      %.3f   %.6f     %.6f           %.1e\n", strip.name(), zones, error,
                  last > 0.0 ? error / last : 0.0, behind * 1e-9, limit * 1e-9, residual);
      EXPECT_LT(std::abs(residual), 1e-13);
      if (last > 0.0) {
        EXPECT_LT(error / last, 0.6);  // first order: the fronts are steps
      }
      if (zones == 400) {
        EXPECT_LT(error, 0.010);
        EXPECT_NEAR(behind / exact.stress, 1.0, 2e-4);
        EXPECT_NEAR(limit / exact.elastic_stress, 1.0, 2e-3);
      }
      last = error;
    }
  }
}

// State after the impact of one metal on another, both beyond their elastic limits: the velocity at which the stresses
// agree.
struct Impact {
  double velocity, stress;
};
Impact impact(const MieGrueneisen& flyer, double g1, double y1, const MieGrueneisen& target, double g2, double y2,
              double speed) {
  const double u = root(1.0, speed - 1.0, [&](double v) {
    return two_waves(target, g2, y2, v).stress - two_waves(flyer, g1, y1, speed - v).stress;
  });
  return {u, two_waves(target, g2, y2, u).stress};
}

TEST(Hydro2dShock, ExactImpactsAreThePublishedOnes) {
  const Impact same = impact(steel_304(), 77e9, 340e6, steel_304(), 77e9, 340e6, 600.0);
  EXPECT_NEAR(same.velocity, 300.0, 1e-6);
  EXPECT_NEAR(same.stress / 12.0111e9, 1.0, 1e-4);
  const Impact other = impact(steel_304(), 77e9, 340e6, aluminium_6061(), 27.6e9, 200e6, 600.0);
  EXPECT_NEAR(other.velocity / 425.515, 1.0, 1e-4);
  EXPECT_NEAR(other.stress / 6.7814e9, 1.0, 1e-4);
}

// A flyer strikes a target across a slide line.
TEST(Hydro2dShock, FlyersOnTargets) {
  struct Metal {
    MieGrueneisen eos;
    double shear_modulus, yield;
  };
  const Metal aluminium = {aluminium_6061(), 27.6e9, 200e6}, steel = {steel_304(), 77e9, 340e6};
  constexpr double kSpeed = 600.0, kLength = 10e-3, kTime = 1.2e-6;
  std::printf("symmetry flyer on target   velocity (exact)      stress/GPa (exact)   energy residual\n");
  for (const Symmetry symmetry : {Symmetry::kPlane, Symmetry::kAxisymmetric}) {
    const Strip strip{symmetry};
    for (const Metal& target : {aluminium, steel}) {
      const Impact exact =
          impact(steel.eos, steel.shear_modulus, steel.yield, target.eos, target.shear_modulus, target.yield, kSpeed);
      constexpr int kZones = 200;
      Mesh mesh(symmetry);
      strip.add(mesh, kZones, 0.0, kLength);
      strip.add(mesh, kZones, -kLength, 0.0);
      Bodies bodies(mesh);
      int k = 0;
      for (const Metal& metal : {target, steel}) {
        bodies.materials.push_back(
            {.eos = Eos(metal.eos), .strength = constant_yield(metal.eos.density, metal.shear_modulus, metal.yield)});
        fill(bodies, k, metal.eos.density, 0.0, strip.along(k == 0 ? 0.0 : kSpeed));
        strip.guide(bodies, bodies.mesh.blocks()[k]);
        ++k;
      }
      bodies.slide_lines.push_back(
          {strip.face(bodies.mesh.blocks()[0], false), strip.face(bodies.mesh.blocks()[1], true)});
      Cycle cycle(std::move(bodies));
      const double before = cycle.ledger().total_energy();
      cycle.run_to(kTime);
      const double face = exact.velocity * kTime;
      const double stress = mean_stress(strip, cycle, kZones, face + 0.5e-3, face + 3e-3);
      const double velocity = strip.component(cycle.state().velocity[cycle.contact().weights().node(0)]);
      const double residual = (cycle.ledger().total_energy() - before - cycle.ledger().work_given) / before;
      std::printf("%s    steel on %s %.3f (%.3f)     %.4f (%.4f)     %.1e\n", strip.name(),
                  target.eos.density < 5000.0 ? "aluminium" : "steel    ", velocity, exact.velocity, stress * 1e-9,
                  exact.stress * 1e-9, residual);
      EXPECT_NEAR(velocity / exact.velocity, 1.0, 2e-3);
      EXPECT_NEAR(stress / exact.stress, 1.0, 2e-3);
      EXPECT_LT(std::abs(residual), 1e-13);
    }
  }
}

}  // namespace
}  // namespace shearbus
