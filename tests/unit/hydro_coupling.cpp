// What couples the mesh and the layers: graded zones, the thickness of plastic layers, and the limits of the soft metal.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <string>

#include "hydro_stub/cone_target.hpp"
#include "hydro_stub/grading.hpp"
#include "hydro_stub/interface_line.hpp"
#include "hydro_stub/metal_bands.hpp"
#include "hydro_stub/problem.hpp"
#include "hydro_stub/shear_limits.hpp"
#include "hydro_stub/wall_zones.hpp"
#include "proto/wire/status.hpp"
#include "shearbus_places.hpp"
#include "tests/support/refused.hpp"

namespace shearbus::hydro {
namespace {

using ::testing::DoubleNear;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const std::string kScene =
    "name = \"coupling\"\nstrategy = \"force_driven\"\n[soft]\nmaterial = \"aluminium_dlp\"\n"
    "yield_strength_max_pa = 0.68e9\nmelting_curve = \"lindemann\"\n[hard]\nmaterial = \"steel_dlp\"\n"
    "[interface]\nfriction_coefficient = 0.3\nyield_strength_pa = 0.68e9\nplastic_layer = true\n[layer]\ncells = 40\n";

SceneFile cone(const std::string& keys, const std::string& layer = "") {
  return parse_scene(kScene + layer + "[hydro]\nend_time_s = 1e-6\n[hydro.cone_target]\n" + keys, "cone.toml");
}

TEST(Grading, ZonesGrowFromTheFirstAndFillTheBody) {
  const GradedNodes nodes = graded_nodes(6.5e-3, {.first = 10e-6, .growth = 1.2, .widest = 0.25e-3});
  EXPECT_EQ(nodes.distance[1], 10e-6);
  EXPECT_EQ(nodes.distance.back(), 6.5e-3);
  for (std::size_t k = 2; k < nodes.distance.size(); ++k) {
    const double before = nodes.distance[k - 1] - nodes.distance[k - 2],
                 here = nodes.distance[k] - nodes.distance[k - 1];
    EXPECT_GT(here, 0.0);
    EXPECT_LT(here / before, 1.25);
    EXPECT_LT(here, 1.15 * 0.25e-3);
  }
  // one thickness: the zone at the wall has exactly it
  EXPECT_EQ(graded_nodes(6.4e-3, {.first = 0.25e-3, .growth = 1.2, .widest = 0.25e-3}).distance[1], 0.25e-3);
}

std::string refusal(const std::string& keys) {
  const wire::Status fault = support::fault_of([&] { make_cone_target(cone(keys).scene); });
  return fault.ok() ? "" : fault.field + ": " + fault.text + " | " + fault.remedy;
}

TEST(Grading, ConesThatCannotBeMeshedAreRefusedWithKeyValueAndRemedy) {
  EXPECT_THAT(
      refusal("zone_width_m = 0.25e-3\nfirst_zone_m = 0.5e-3\n"),
      HasSubstr("hydro.cone_target.first_zone_m: hydro.cone_target.first_zone_m = 0.0005 m is more than the other "
                "zones' 0.00025 m | zones grow"));
  EXPECT_THAT(refusal("zone_width_m = 0.05e-3\nfirst_zone_m = 1e-6\nzone_growth = 1\n"), HasSubstr("zone_growth"));
  EXPECT_THAT(
      refusal("zone_width_m = 1e-3\nconfinement_radius_m = 0.9\nfirst_zone_m = 1e-6\nzone_growth = 1.00000001\n"),
      HasSubstr("hydro.cone_target.zone_growth: hydro.cone_target.zone_growth = 1.00000001 makes 9e+05 zones"));
  EXPECT_EQ(refusal("zone_width_m = 0.25e-3\nfirst_zone_m = 10e-6\n"), "");
}

TEST(Grading, TheWallZonesOfAConeAreAsThickAsAskedAllAlongTheFlank) {
  for (const double first : {10e-6, 0.25e-3}) {
    const SceneFile file = cone("zone_width_m = 0.5e-3\nfirst_zone_m = " + std::to_string(first) + "\n");
    EXPECT_THAT(half_wall_zones(make_bodies(make_cone_target(file.scene))), Each(DoubleNear(0.5 * first, 1e-11)));
  }
  // Without the key zones are as before: they narrow with the cone.
  const std::vector<double> half =
      half_wall_zones(make_bodies(make_cone_target(cone("zone_width_m = 0.5e-3\n").scene)));
  const auto [thinnest, thickest] = std::ranges::minmax(half);
  EXPECT_NEAR(thickest / thinnest, 1.58, 0.02);
}

TEST(PlasticLayers, AreHalfAWallZoneAndNothingElse) {
  const std::string keys = "zone_width_m = 0.5e-3\nfirst_zone_m = 0.25e-3\n";
  const std::vector<double> half(3, 125e-6);
  EXPECT_EQ(plastic_layers(cone(keys), half), half);
  EXPECT_EQ(plastic_layers(cone(keys, "thickness_m = 125e-6\n"), half), half);
  const wire::Status fault = support::fault_of([&] { plastic_layers(cone(keys, "thickness_m = 20e-6\n"), half); });
  EXPECT_EQ(fault.field, "layer.thickness_m");
  EXPECT_THAT(fault.text, HasSubstr("layer.thickness_m = 2e-05 m, but half the wall zones is 0.000125"));
  EXPECT_THAT(fault.remedy, HasSubstr("leave layer.thickness_m out"));
  std::string without = cone(keys).text;
  without.replace(without.find("plastic_layer = true"), 20, "");
  EXPECT_THAT(plastic_layers(parse_scene(without, "cone.toml"), half), IsEmpty());
}

// Largest adiabatic flow stress and critical jump of the default cone's aluminium, calculated independently.
TEST(ShearLimits, OfThePapersAluminium) {
  const physics::Material soft = resolve(cone("").scene.scene().soft(), "soft");
  const physics::Material hard = resolve(cone("").scene.scene().hard(), "hard");
  const AdiabaticPeak peak = adiabatic_peak(soft, 0.0, 300.0);
  EXPECT_NEAR(peak.stress, 301e6, 1e6);
  EXPECT_NEAR(peak.strain, 1.17, 0.03);
  const CriticalJump jump(soft, hard, 300.0);
  for (const auto& [pressure, exact] :
       {std::pair{2e9, 188.0}, {4e9, 200.0}, {6e9, 212.0}, {8e9, 223.0}, {11.2e9, 240.0}}) {
    std::printf("critical jump at %4.1f GPa: %.1f m/s (%.0f)\n", 1e-9 * pressure, jump.at(pressure), exact);
    EXPECT_NEAR(jump.at(pressure) / exact, 1.0, 0.01);
  }
  const InterfaceStrength strong = interface_strength(cone("").scene, soft);
  EXPECT_TRUE(strong.too_strong());
  EXPECT_THAT(strength_warning(strong), IsEmpty()) << "the layer flows";
  InterfaceStrength bare = strong;
  bare.flows_in_layer = false;
  EXPECT_THAT(strength_warning(bare), HasSubstr("interface.yield_strength_pa = 6.8e+08 Pa is above Y* = 3.0"));
}

// The mean of a profile that is linear along an interface is that of its two ends, however wide the zones are.
TEST(InterfaceLine, TheMeanOfALinearProfileIsExact) {
  for (const double zone : {1e-3, 0.25e-3}) {
    const lagrange::Bodies bodies =
        make_bodies(make_cone_target(cone("zone_width_m = " + std::to_string(zone) + "\n").scene));
    const InterfaceLine line(bodies);
    std::vector<double> height;
    for (const lagrange::SlideLine& side : bodies.slide_lines) {
      if (!side.rubs) continue;
      for (const int n : side.soft.nodes) height.push_back(bodies.mesh.places()[n].y);
    }
    ASSERT_EQ(line.lengths().size(), height.size());
    EXPECT_NEAR(line.mean(height), 0.5 * (height.front() + height.back()), 1e-15);
    // a profile that is linear in the last zone, and 0 elsewhere
    std::vector<double> at_the_end(height.size(), 0.0);
    at_the_end.back() = 1.0;
    const double whole = std::accumulate(line.lengths().begin(), line.lengths().end(), 0.0);
    EXPECT_NEAR(line.mean(at_the_end), line.lengths().back() / whole, 1e-15);
    EXPECT_NEAR(line.lengths().back() * (static_cast<double>(height.size()) - 1.0) / whole, 0.5, 1e-3);
    // A window of it: an uneven end does not pull the mean.
    const std::size_t first = 1, last = height.size() - 4;
    EXPECT_NEAR(*line.mean(height, [&](std::size_t i) { return i >= first && i <= last; }),
                0.5 * (height[first] + height[last]), 1e-15);
    EXPECT_EQ(*line.mean(height, [](std::size_t i) { return i == 2; }), height[2]);
    EXPECT_EQ(line.mean(height, [](std::size_t) { return false; }), std::nullopt);
  }
}

// A rigid shift of one body against the other is the displacement over every band.
TEST(MetalBands, SeeTheShiftOfTheBodies) {
  const ConeTarget problem = make_cone_target(cone("zone_width_m = 0.5e-3\nfirst_zone_m = 0.1e-3\n").scene);
  lagrange::Bodies bodies = make_bodies(problem);
  std::ranges::fill(bodies.velocity, lagrange::Vec2{});
  for (int n = 0; n < bodies.mesh.blocks()[ConeTarget::kCone].num_nodes(); ++n) bodies.velocity[n] = {0.0, 3.0};
  const MetalBands bands(bodies);
  lagrange::Cycle cycle(std::move(bodies));
  cycle.advance(1e-12);
  for (int i = 0; i < cycle.contact().size(); ++i) {
    for (std::size_t band = 0; band < MetalBands::kDistances.size(); ++band) {
      ASSERT_TRUE(bands.reaches(band, i)) << i;
      EXPECT_NEAR(bands.velocity_difference(cycle, band, i), 3.0 * cycle.contact().weights().tangent(i).y, 1e-6) << i;
    }
  }
}

}  // namespace
}  // namespace shearbus::hydro
