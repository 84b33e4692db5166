// Plastic flow at large strain: shells that implode until plastic work has stopped them, and Taylor's bar. Each test
// prints its table.
#include <gtest/gtest.h>

#include <numbers>

#include "tests/support/hydro2d.hpp"

namespace shearbus {
namespace {

using namespace test;  // NOLINT(google-build-using-namespace)

// Beryllium; the exact solutions are those of an incompressible, perfectly plastic metal.
constexpr MieGrueneisen kBeryllium = {
    .density = 1845.0, .sound_speed = 7998.0, .s1 = 1.124, .gamma0 = 1.11, .specific_heat = 1820.0};
constexpr double kYield = 330e6;
constexpr double kInner = 80e-3;
constexpr double kOuter = 100e-3;

BodyMaterial beryllium() {
  return {.eos = Eos(kBeryllium), .strength = constant_yield(kBeryllium.density, 151e9, kYield)};
}

// Runs until the inner surface stops, and returns its mean radius there.
double stopping_radius(Cycle& cycle, const std::vector<int>& inner) {
  const auto mean = [&](const std::vector<Vec2>& v, bool along_radius) {
    double sum = 0.0;
    for (const int n : inner) {
      const Vec2 x = cycle.state().position[n];
      sum += along_radius ? dot(v[n], x) / norm(x) : norm(v[n]);
    }
    return sum / static_cast<double>(inner.size());
  };
  while (mean(cycle.state().velocity, true) < 0.0) cycle.advance(1.0);
  return mean(cycle.state().position, false);
}

// Initial inner speeds 417.08 and 454.65 m/s stop at radii of 50 and 45 mm (B. Verney; G. Howell & G. Ball, J. Comput.
// Phys. 175 (2002) 128).
TEST(Hydro2dMetals, ImplodingCylinderStopsWherePlasticWorkHasTakenItsEnergy) {
  std::printf("imploding cylinder   zones  stops at/mm (exact)  energy residual\n");
  for (const Symmetry symmetry : {Symmetry::kAxisymmetric, Symmetry::kPlane}) {
    const bool plane = symmetry == Symmetry::kPlane;
    for (const auto& [speed, exact] : {std::pair{417.08, 50e-3}, std::pair{454.65, 45e-3}}) {
      for (const int zones : {10, 20}) {
        constexpr int kAround = 4;
        constexpr double kAngle = 0.2;  // of the sector
        Mesh mesh(symmetry);
        // Plane: a sector, radius along i. Axisymmetric: a slice of a long cylinder.
        const lagrange::Block block = mesh.add_block(zones, kAround, [&](int i, int j) {
          const double r = kInner + (kOuter - kInner) * i / zones;
          const double angle = kAngle * j / kAround;
          return plane ? Vec2{r * std::cos(angle), r * std::sin(angle)} : Vec2{r, (kOuter - kInner) * j / zones};
        });
        Bodies bodies(mesh);
        bodies.materials.push_back(beryllium());
        fill(bodies, 0, kBeryllium.density, 0.0, {});
        for (std::size_t n = 0; n < bodies.velocity.size(); ++n) {
          const Vec2 x = plane ? bodies.mesh.places()[n] : Vec2{bodies.mesh.places()[n].x, 0.0};
          bodies.velocity[n] = (-speed * kInner / dot(x, x)) * x;
        }
        bodies.walls.push_back({block.side(Side::kBottom), {0.0, 1.0}, 0.0});
        bodies.walls.push_back(
            {block.side(Side::kTop), plane ? Vec2{-std::sin(kAngle), std::cos(kAngle)} : Vec2{0.0, 1.0}, 0.0});
        Cycle cycle(std::move(bodies));
        const double before = cycle.ledger().total_energy();
        // On the slice the radius is the first coordinate alone.
        double radius = 0.0;
        if (plane) {
          radius = stopping_radius(cycle, block.side(Side::kLeft));
        } else {
          while (cycle.state().velocity[block.node(0, 0)].x < 0.0) cycle.advance(1.0);
          radius = cycle.state().position[block.node(0, 0)].x;
        }
        std::printf(" %s %6.2f m/s  %3d    %.3f (%.0f)          %.1e\n", plane ? "plane" : "slice", speed, zones,
                    radius * 1e3, exact * 1e3, (cycle.ledger().total_energy() - before) / before);
        EXPECT_NEAR(radius / exact, 1.0, zones == 20 ? 0.005 : 0.01);
      }
    }
  }
}

// rho u0^2 R0^3 (1 - R0/R1) = 4 Y integral of r^2 ln(r_start/r) dr over the shell where it stops.
double sphere_speed(double stop) {
  const auto start = [&](double r) { return std::cbrt(kInner * kInner * kInner + r * r * r - stop * stop * stop); };
  const double outer = std::cbrt(kOuter * kOuter * kOuter - kInner * kInner * kInner + stop * stop * stop);
  double work = 0.0;
  constexpr int kParts = 2000;
  for (int i = 0; i < kParts; ++i) {
    const double r = stop + (outer - stop) * (i + 0.5) / kParts;
    work += r * r * std::log(start(r) / r) * (outer - stop) / kParts;
  }
  return std::sqrt(4.0 * kYield * work / (kBeryllium.density * kInner * kInner * kInner * (1.0 - kInner / kOuter)));
}

TEST(Hydro2dMetals, ImplodingSphereStopsWherePlasticWorkHasTakenItsEnergy) {
  constexpr double kStop = 60e-3;
  const double speed = sphere_speed(kStop);
  std::printf("imploding sphere, %.2f m/s   zones   stops at/mm (60)  spread of the inner radius/mm  energy residual\n",
              speed);
  for (const int zones : {8, 16}) {
    const int around = 2 * zones;
    Mesh mesh(Symmetry::kAxisymmetric);
    const lagrange::Block block = mesh.add_block(around, zones, [&](int i, int j) {
      const double r = kOuter + (kInner - kOuter) * j / zones;
      const double angle = 0.5 * std::numbers::pi * i / around;  // from the equator to the axis
      return Vec2{i == around ? 0.0 : r * std::cos(angle), i == 0 ? 0.0 : r * std::sin(angle)};
    });
    Bodies bodies(mesh);
    bodies.materials.push_back(beryllium());
    fill(bodies, 0, kBeryllium.density, 0.0, {});
    for (std::size_t n = 0; n < bodies.velocity.size(); ++n) {
      const Vec2 x = bodies.mesh.places()[n];
      const double r = norm(x);
      bodies.velocity[n] = (-speed * kInner * kInner / (r * r * r)) * x;
    }
    bodies.walls.push_back({block.side(Side::kLeft), {0.0, 1.0}, 0.0});
    bodies.walls.push_back({block.side(Side::kRight), {1.0, 0.0}, 0.0});
    Cycle cycle(std::move(bodies));
    const double before = cycle.ledger().total_energy();
    const std::vector<int> inner = block.side(Side::kTop);
    const double radius = stopping_radius(cycle, inner);
    double low = 1.0, high = 0.0;
    for (const int n : inner) {
      low = std::min(low, norm(cycle.state().position[n]));
      high = std::max(high, norm(cycle.state().position[n]));
    }
    std::printf("                            %3d       %.3f            %.3f                      %.1e\n", zones,
                radius * 1e3, (high - low) * 1e3, (cycle.ledger().total_energy() - before) / before);
    EXPECT_NEAR(radius / kStop, 1.0, zones == 16 ? 0.003 : 0.02);
    EXPECT_LT(high - low, 0.03 * kStop);
  }
}

// Copper bar, 32.4 mm by 3.2 mm, 227 m/s against a rigid wall, Y = 400 MPa + 100 MPa ep; codes in the literature find a
// length of 21.4-21.7 mm and a foot radius of 6.97-7.24 mm at 80 us.
TEST(Hydro2dMetals, TaylorBar) {
  std::printf("Taylor bar  zones     steps   length/mm  foot radius/mm  kinetic left  energy residual\n");
  for (const int across : {5, 10}) {
    constexpr double kRadius = 3.2e-3, kLength = 32.4e-3;
    const int along = 10 * across;
    Mesh mesh(Symmetry::kAxisymmetric);
    const lagrange::Block block =
        mesh.add_block(across, along, rectangle(across, along, {0.0, 0.0}, {kRadius, kLength}));
    Bodies bodies(mesh);
    physics::Material copper = constant_yield(8930.0, 43.33e9, 400e6);
    copper.hardening_coefficient = 0.25;  // with exponent 1: linear
    bodies.materials.push_back(
        {.eos = Eos(MieGrueneisen{
             .density = 8930.0, .sound_speed = 3940.0, .s1 = 1.489, .gamma0 = 2.02, .specific_heat = 385.0}),
         .strength = copper});
    fill(bodies, 0, 8930.0, 0.0, {0.0, -227.0});
    for (const int n : block.side(Side::kBottom)) bodies.velocity[n].y = 0.0;
    bodies.walls.push_back({block.side(Side::kBottom), {0.0, 1.0}, 0.0});
    bodies.walls.push_back({block.side(Side::kLeft), {1.0, 0.0}, 0.0});
    Cycle cycle(std::move(bodies));
    const lagrange::Ledger start = cycle.ledger();
    cycle.run_to(80e-6);
    const lagrange::Ledger end = cycle.ledger();
    const double length = cycle.state().position[block.node(0, along)].y;
    const double foot = cycle.state().position[block.node(across, 0)].x;
    std::printf("          %3d x %3d  %6d   %.3f     %.3f          %.4f        %.1e\n", across, along,
                static_cast<int>(cycle.steps()), length * 1e3, foot * 1e3, end.kinetic / start.kinetic,
                (end.total_energy() - end.work_given) / start.total_energy() - 1.0);
    EXPECT_NEAR(end.total_energy() - end.work_given, start.total_energy(), 1e-12 * start.total_energy());
    if (across == 10) {
      EXPECT_GT(length, 21.3e-3);
      EXPECT_LT(length, 21.8e-3);
      EXPECT_GT(foot, 6.9e-3);
      EXPECT_LT(foot, 7.3e-3);
    }
    EXPECT_LT(end.kinetic, 0.02 * start.kinetic);
  }
}

}  // namespace
}  // namespace shearbus
