// Tests of the map that shows where the velocity-driven model is valid: the map is compared with closed formulas.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "client/study/map/limits.hpp"
#include "client/study/map/sweep.hpp"
#include "server/physics/material/strength.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus {
namespace {

v1::Scene scene() {
  v1::Scene scene = support::velocity_scene();
  scene.mutable_layer()->set_far_boundary(v1::FAR_BOUNDARY_HALF_SPACE);
  return scene;
}

map::SceneText text_of(const v1::Scene& scene) {
  return {.text = support::text_of(scene), .file = "scene"};
}

const map::Axes kAxes{map::log_spaced(1e9, 100e9, 4), map::log_spaced(1.0, 1000.0, 13)};
constexpr double kThickness = 20e-6;

const map::Map& small_map() {
  static const map::Map made = map::sweep(text_of(scene()), kAxes, {50e-9, 100e-9, 400e-9}, 1e-9);
  return made;
}

TEST(ValidityMap, AxesAreAtEqualRatios) {
  EXPECT_EQ(kAxes.velocity_m_per_s.front(), 1.0);
  EXPECT_EQ(kAxes.velocity_m_per_s.back(), 1000.0);
  EXPECT_NEAR(kAxes.velocity_m_per_s[4] / kAxes.velocity_m_per_s[3], std::pow(10.0, 0.25), 1e-12);
}

// The part of the imposed displacement V t that is not plastic slip is elastic: sqrt(3) integral(ep) = V t - h s / G0,
// with the plastic strain ep, integrated over the layer, the layer's thickness h, the shear stress s and the shear
// modulus G0.
TEST(ValidityMap, WhatIsNotCarriedIsElastic) {
  const double G0 = physics::make_material("aluminium_dlp", {}).material.shear_modulus;
  for (const map::Observation& seen : small_map().observations) {
    const std::vector<double> shares = map::slip_share(small_map(), seen);
    for (std::size_t p = 0; p < kAxes.pressure_pa.size(); ++p) {
      for (std::size_t v = 0; v < kAxes.velocity_m_per_s.size(); ++v) {
        const std::size_t i = kAxes.node(p, v);
        const double elastic = kThickness * seen.shear_stress_pa[i] / (G0 * kAxes.velocity_m_per_s[v] * seen.time_s);
        EXPECT_NEAR(shares[i], 1.0 - elastic, 1e-8) << p << " " << v;
        EXPECT_EQ(seen.regime[i] == static_cast<std::uint8_t>(wire::Regime::kStick), shares[i] == 0.0) << p << " " << v;
      }
    }
  }
}

// The layer yields when the elastic stress G0 V t / h, with the shear modulus G0 and the layer's thickness h, reaches
// the flow stress at the pressure and 300 K, divided by sqrt(3). The limiting velocity V therefore falls as 1/t.
TEST(ValidityMap, TheStickingLineIsThatOfElasticLoading) {
  const physics::Material soft = physics::make_material("aluminium_dlp", {}).material;
  int drawn = 0;
  for (const map::Observation& seen : small_map().observations) {
    const map::Line line = map::velocity_of_share(small_map(), seen, 0.0);
    for (std::size_t p = 0; p < line.size(); ++p) {
      const double yield = physics::flow_stress(soft, 0.0, kAxes.pressure_pa[p], 300.0) / std::sqrt(3.0);
      const double expected = kThickness * yield / (soft.shear_modulus * seen.time_s);
      EXPECT_EQ(line[p].has_value(), expected > 1.0) << p << ": " << expected;
      if (!line[p]) continue;
      ++drawn;
      // The tolerance is 15 % because `expected` is for a layer that has not hardened. In the map the layer has
      // hardened a little at the lowest velocity at which it flows.
      EXPECT_NEAR(*line[p] / expected, 1.0, 0.15) << p;
    }
  }
  EXPECT_GE(drawn, 8);
}

TEST(ValidityMap, TheDomainGrowsWithTheTimeOfObservation) {
  const auto& seen = small_map().observations;
  for (std::size_t k = 1; k < seen.size(); ++k) {
    const map::Line before = map::velocity_of_share(small_map(), seen[k - 1], 0.9);
    const map::Line after = map::velocity_of_share(small_map(), seen[k], 0.9);
    for (std::size_t p = 0; p < before.size(); ++p) {
      ASSERT_TRUE(before[p]);
      // The limiting velocity is proportional to s/t, with the shear stress s. It falls a little less than 1/t does,
      // because s rises as the layer hardens.
      const double elapsed = seen[k].time_s / seen[k - 1].time_s;
      if (after[p]) {
        EXPECT_GT(*before[p] / *after[p] / elapsed, 0.5) << p;
        EXPECT_LT(*before[p] / *after[p] / elapsed, 1.05) << p;
      }
    }
  }
}

TEST(ValidityMap, FasterMeltsEarlierAndTheLineFallsWithTime) {
  const map::Map& made = small_map();
  int melted = 0;
  for (std::size_t p = 0; p < kAxes.pressure_pa.size(); ++p) {
    for (std::size_t v = 1; v < kAxes.velocity_m_per_s.size(); ++v) {
      const double slower = made.melting_time_s[kAxes.node(p, v - 1)];
      const double faster = made.melting_time_s[kAxes.node(p, v)];
      if (std::isnan(slower)) continue;
      EXPECT_LE(faster, slower);
      ++melted;
    }
  }
  EXPECT_GT(melted, 4);
  const map::Line early = map::velocity_of_melting(made, 100e-9);
  const map::Line late = map::velocity_of_melting(made, 400e-9);
  for (std::size_t p = 0; p < early.size(); ++p) {
    ASSERT_TRUE(early[p] && late[p]);
    EXPECT_LT(*late[p], *early[p]);
  }
}

TEST(ValidityMap, ASceneWithoutImposedShearIsRefused) {
  EXPECT_THROW(map::sweep(text_of(support::force_scene()), kAxes, {1e-9}, 1e-9), Error);
  v1::Scene slip = scene();
  slip.mutable_velocity_driven()->set_drive(v1::DRIVE_INTERFACE_SLIP);
  EXPECT_THROW(map::sweep(text_of(slip), kAxes, {1e-9}, 1e-9), Error);
}

}  // namespace
}  // namespace shearbus
