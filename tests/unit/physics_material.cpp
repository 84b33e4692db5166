#include "server/physics/material/material.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "server/physics/material/strength.hpp"

namespace shearbus::physics {
namespace {

using Given = std::vector<std::pair<std::string, double>>;

Material aluminium() {
  return make_material("aluminium_dlp", {}).material;
}

TEST(PhysicsMaterial, SofteningIsThePrintedFormulaBelowMelting) {
  const Material m = aluminium();
  for (double T : {200.0, 300.0, 700.0, 1000.0, 1200.0, 1219.0, 1219.9}) {
    for (double P : {0.0, 1e9, 11.2e9}) {
      const double printed = (1 + 6.52e-11 * P - 6.16e-4 * (T - 300)) * std::exp(-0.001 * T / (1220 - T));
      EXPECT_NEAR(softening(m, P, T).g, printed, 1e-14) << T << " K, " << P << " Pa";
    }
  }
}

TEST(PhysicsMaterial, SofteningSlopeIsItsDerivative) {
  const Material m = aluminium();
  for (double T : {300.0, 900.0, 1200.0, 1215.0, 1219.0}) {
    const double dT = 1e-5 * (1220 - T);
    const double slope = (softening(m, 11.2e9, T + dT).g - softening(m, 11.2e9, T - dT).g) / (2 * dT);
    EXPECT_NEAR(softening(m, 11.2e9, T).slope, slope, 1e-6 * std::abs(slope)) << T;
  }
}

TEST(PhysicsMaterial, NothingIsCarriedAtMeltingAndAbove) {
  const Material m = aluminium();
  const double below = std::nextafter(1220.0, 0.0);
  for (double T : {below, 1220.0, 1220.5, 1e6, 1e300}) {
    EXPECT_EQ(softening(m, 11.2e9, T).g, 0.0) << T;
    EXPECT_EQ(softening(m, 11.2e9, T).slope, 0.0) << T;
    EXPECT_EQ(flow_stress(m, 1e3, 11.2e9, T), 0.0) << T;
  }
}

TEST(PhysicsMaterial, BracketIsClippedWhereHeatOutweighsPressure) {
  Material m = aluminium();
  m.temperature_coefficient = 5e-3;
  EXPECT_EQ(softening(m, 0.0, 600.0).g, 0.0);
  EXPECT_EQ(softening(m, -20e9, 300.0).g, 0.0);  // tension of 20 GPa leaves no strength
  EXPECT_GT(softening(m, 11.2e9, 600.0).g, 0.0);
}

TEST(PhysicsMaterial, SofteningIsANumberForAnyInput) {
  const Material m = aluminium();
  for (double T : {-1e308, 0.0, 1219.999999, 1220.0, 1e308}) {
    for (double P : {-1e308, 0.0, 1e308}) {
      const Softening s = softening(m, P, T);
      EXPECT_FALSE(std::isnan(s.g) || std::isnan(s.slope)) << T << ", " << P;
      EXPECT_GE(s.g, 0.0);
    }
  }
}

TEST(PhysicsMaterial, HardeningSaturatesAtItsMaximum) {
  Material m = make_material("aluminium_6061_t6", {}).material;
  EXPECT_NEAR(hardened_strength(m, 0.0, 0.0, 0.0, 300.0), 290e6, 1.0);
  EXPECT_NEAR(hardened_strength(m, 0.1, 0.0, 0.0, 300.0), 290e6 * std::pow(1 + 12.5, 0.1), 1.0);
  EXPECT_EQ(hardened_strength(m, 1e9, 0.0, 0.0, 300.0), 0.68e9);
  // the material aluminium_dlp has no largest yield strength
  EXPECT_GT(hardened_strength(aluminium(), 1e9, 0.0, 0.0, 300.0), 2e9);
}

TEST(PhysicsMaterial, HeatPartitionOfThePaperIs0Point6772) {
  const Material steel = make_material("steel_dlp", {}).material;
  EXPECT_NEAR(heat_partition(aluminium(), steel), 0.6772, 5e-5);
  EXPECT_NEAR(heat_partition(aluminium(), steel) + heat_partition(steel, aluminium()), 1.0, 1e-15);
}

TEST(PhysicsMaterial, CatalogEntriesAreCompleteAndSourced) {
  for (const CatalogEntry& entry : catalog()) {
    EXPECT_FALSE(entry.source.empty()) << entry.name;
    // The constants of a catalog entry make the same material again: they contain every constant that its flow law
    // needs and none that only another law needs.
    const Given constants = constants_of(entry.material);
    const MaterialResult again = make_material("", constants, entry.material.flow_law);
    EXPECT_EQ(again.fault, "") << entry.name << " " << again.fault_field;
    EXPECT_EQ(constants_of(again.material), constants) << entry.name;
    EXPECT_TRUE(entry.material.conductivity < 500.0 && entry.material.diffusivity < 2e-4) << entry.name;
  }
}

// Published tables differ from each other. The test has the values of the sources that the catalog names, converted
// from the printed units (GPa, MPa, 1/TPa, 1/kK) to SI units.
TEST(PhysicsMaterial, CatalogHoldsThePublishedConstants) {
  const Material copper = make_material("copper_ofhc", {}).material;
  EXPECT_DOUBLE_EQ(copper.shear_modulus, 47.7e9);
  EXPECT_DOUBLE_EQ(copper.yield_strength, 120e6);
  EXPECT_DOUBLE_EQ(copper.yield_strength_max, 640e6);
  EXPECT_DOUBLE_EQ(copper.pressure_coefficient, 28.3e-12);
  EXPECT_DOUBLE_EQ(copper.temperature_coefficient, 0.377e-3);
  const Material steel = make_material("steel_4340_jc", {}).material;
  EXPECT_EQ(FlowLaws::name_of(steel.flow_law), "johnson_cook");
  // Flow stress of steel 4340 by Johnson and Cook 1985: 792 + 510 ep^0.26 [MPa] at the reference rate and at room
  // temperature; 9.67 % more at 1000/s.
  EXPECT_NEAR(flow_stress(steel, 0.1, 0.0, 298.0), 1072.26e6, 0.01e6);
  EXPECT_NEAR(flow_stress(steel, 0.1, 0.0, 298.0, 1000.0) / flow_stress(steel, 0.1, 0.0, 298.0), 1.0967, 1e-4);
}

TEST(PhysicsMaterial, WhatIsGivenOverridesTheCatalog) {
  const auto result =
      make_material("aluminium_dlp", Given{{"yield_strength_pa", 250e6}, {"yield_strength_max_pa", 0.68e9}});
  ASSERT_EQ(result.fault, "");
  EXPECT_EQ(result.material.yield_strength, 250e6);
  EXPECT_EQ(result.material.yield_strength_max, 0.68e9);
  EXPECT_EQ(result.material.shear_modulus, 27.6e9);
}

TEST(PhysicsMaterial, CatalogDiffusivityLeavesWithTheConstantsItBelongsTo) {
  EXPECT_EQ(make_material("aluminium_dlp", Given{{"yield_strength_pa", 1e8}}).material.diffusivity, 48.9e-6);
  EXPECT_DOUBLE_EQ(make_material("aluminium_dlp", Given{{"specific_heat_j_per_kg_k", 450}}).material.diffusivity,
                   117.0 / (2703 * 450));
  const Given both{{"specific_heat_j_per_kg_k", 450}, {"thermal_diffusivity_m2_per_s", 5e-5}};
  EXPECT_EQ(make_material("aluminium_dlp", both).material.diffusivity, 5e-5);
}

TEST(PhysicsMaterial, AMaterialCanBeGivenWithoutTheCatalog) {
  Given all;
  for (const auto& [name, value] : constants_of(aluminium())) all.emplace_back(name, value);
  const auto result = make_material("", all);
  ASSERT_EQ(result.fault, "");
  EXPECT_EQ(constants_of(result.material), all);
  EXPECT_EQ(result.material.yield_strength_max, std::numeric_limits<double>::infinity());
}

TEST(PhysicsMaterial, FaultsNameTheFieldAndTheNearestName) {
  EXPECT_EQ(make_material("aluminum_dlp", {}).fault_field, "material");
  EXPECT_NE(make_material("copper", {}).fault.find("did you mean \"copper_ofhc\" or \"copper_ofhc_jc\" or"),
            std::string::npos);
  EXPECT_NE(make_material("aluminum_dlp", {}).fault.find("did you mean \"aluminium_dlp\"?"), std::string::npos);
  EXPECT_NE(make_material("steel_dlp", Given{{"yield_strenght_pa", 1.0}}).fault.find("\"yield_strength_pa\""),
            std::string::npos);
  EXPECT_EQ(make_material("", Given{{"density_kg_per_m3", 1.0}}).fault_field, "shear_modulus_pa");
  for (double bad : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    EXPECT_EQ(make_material("steel_dlp", Given{{"melting_temperature_k", bad}}).fault_field, "melting_temperature_k")
        << bad;
  }
  EXPECT_EQ(make_material("steel_dlp", Given{{"hardening_exponent", 1.5}}).fault_field, "hardening_exponent");
  EXPECT_EQ(make_material("steel_dlp", Given{{"hardening_coefficient", 0.0}}).fault, "");
}

}  // namespace
}  // namespace shearbus::physics
