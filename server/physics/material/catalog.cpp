#include <algorithm>
#include <array>

#include "server/physics/material/caution.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/material/material.hpp"

// All of Johnson and Cook's sets, Steinberg's copper, silver and titanium, the sets of 4340 and Ti-6Al-4V, and most constants
// of heat were compared with no other source. The Y_max of 4340 is printed as 0.25 GPa, below its Y0, and is read as 2.5 GPa.
// Melting temperatures are those of each law's calibration. Left out, because a number has no source at hand or two sources
// disagree: the constants of Simon's melting curve; tungsten and other entries of Steinberg's tables; Johnson and Cook's 7039,
// S-7, tungsten and uranium alloys.
namespace shearbus::physics {
namespace {

constexpr double kPascalPerMegapascal = 1e6;
constexpr double kPascalPerGigapascal = 1e9;

// Strength constants as Steinberg prints them: G0 [GPa], Y0 [MPa], Y_max [GPa], beta, n, gP [1/Pa], hT [1/K], T_melt
// [K].
struct Strength {
  double G0, Y0, Y_max, beta, n, gP, hT, T_melt;
};
constexpr double kNoCap = std::numeric_limits<double>::infinity();

// Heat constants: k [W/(m K)], c [J/(kg K)], alpha [m2/s].
struct Heat {
  double k, c, alpha;
};

constexpr Material metal(double density, const Strength& s, const Heat& heat) {
  Material m;
  m.density = density;
  m.shear_modulus = s.G0 * kPascalPerGigapascal;
  m.yield_strength = s.Y0 * kPascalPerMegapascal;
  m.yield_strength_max = s.Y_max * kPascalPerGigapascal;
  m.hardening_coefficient = s.beta;
  m.hardening_exponent = s.n;
  m.pressure_coefficient = s.gP;
  m.temperature_coefficient = s.hT;
  m.melting_temperature = s.T_melt;
  m.conductivity = heat.k;
  m.specific_heat = heat.c;
  m.diffusivity = heat.alpha;
  return m;
}

constexpr Material metal(double density, const Strength& s, double k, double c) {
  return metal(density, s, Heat{k, c, k / (density * c)});
}

// Shock and melting constants as Steinberg prints them: c0 [m/s] and s of the Hugoniot U = c0 + s u; Grueneisen's
// gamma0 and its first-order volume correction a.
struct Compression {
  double c0, s, gamma0, a;
};

constexpr Material with(Material m, const Compression& c) {
  m.sound_speed = c.c0;
  m.hugoniot_slope = c.s;
  m.grueneisen = c.gamma0;
  m.volume_correction = c.a;
  return m;
}

// Constants as Johnson and Cook print them: A, B [MPa], n, C, m, T_melt [K]; rates are per second, room temperature is
// 298 K.
struct JohnsonCookConstants {
  double A, B, n, C, m, T_melt;
};

constexpr Material metal(double density, double G0, const JohnsonCookConstants& s, double k, double c) {
  constexpr double kRoomTemperature = 298.0;
  Material m;
  m.flow_law = FlowLaws::place<JohnsonCook>();
  m.density = density;
  m.shear_modulus = G0 * kPascalPerGigapascal;
  m.yield_strength = s.A * kPascalPerMegapascal;
  m.hardening_modulus = s.B * kPascalPerMegapascal;
  m.hardening_exponent = s.n;
  m.rate_coefficient = s.C;
  m.reference_strain_rate = 1.0;
  m.thermal_exponent = s.m;
  m.reference_temperature = kRoomTemperature;
  m.melting_temperature = s.T_melt;
  m.conductivity = k;
  m.specific_heat = c;
  m.diffusivity = k / (density * c);
  return m;
}

// Constants as Preston, Tonks and Wallace name them; G0 at 0 K [GPa], M [g/mol], T_melt [K].
struct PrestonConstants {
  double G0, alpha, theta, p, s0, s_inf, kappa, gamma, y0, y_inf, y1, y2, beta, M, T_melt;
};

constexpr Material metal(double density, const PrestonConstants& s, double gP, double k, double c) {
  constexpr double kKilogramPerGram = 1e-3;
  Material m;
  m.flow_law = FlowLaws::place<PrestonTonksWallace>();
  m.density = density;
  m.shear_modulus = s.G0 * kPascalPerGigapascal;
  m.modulus_temperature = s.alpha;
  m.work_hardening_rate = s.theta;
  m.work_hardening_curvature = s.p;
  m.saturation_cold = s.s0;
  m.saturation_hot = s.s_inf;
  m.activation = s.kappa;
  m.attempt_rate = s.gamma;
  m.yield_cold = s.y0;
  m.yield_hot = s.y_inf;
  m.medium_rate_yield = s.y1;
  m.medium_rate_exponent = s.y2;
  m.overdriven_exponent = s.beta;
  m.molar_mass = s.M * kKilogramPerGram;
  m.melting_temperature = s.T_melt;
  m.pressure_coefficient = gP;
  m.conductivity = k;
  m.specific_heat = c;
  m.diffusivity = k / (density * c);
  return m;
}

constexpr std::array kCatalog = {
    CatalogEntry{
        "aluminium_dlp",
        "DLP tables: SCG constants of 6061-T6 with Y0 lowered to 200 MPa, heat of Al 5083; alpha as printed (48.9e-6, "
        "not exactly k/(rho c)); no Y_max, as DLP (40); shock and melting: Steinberg's tables, 6061-T6",
        with(metal(2703, {27.6, 200, kNoCap, 125, 0.10, 6.52e-11, 6.16e-4, 1220}, {117, 900, 48.9e-6}),
             {5240, 1.400, 1.97, 1.5})},
    CatalogEntry{"steel_dlp",
                 "DLP tables: stainless steel; alpha as printed; no Y_max, as DLP (40); shock and melting: Steinberg's "
                 "tables, 304",
                 with(metal(7900, {77.0, 340, kNoCap, 43, 0.35, 2.26e-11, 4.55e-4, 2380}, {16.1, 500, 4.076e-6}),
                      {4570, 1.490, 1.93, 1.4})},
    CatalogEntry{
        "aluminium_6061_t6",
        "strength: Steinberg, Cochran, Guinan 1980 and Steinberg's tables, shock and melting too; heat: Aluminum "
        "Association typical values at room temperature (k 167, c 896)",
        with(metal(2703, {27.6, 290, 0.68, 125, 0.10, 6.52e-11, 6.16e-4, 1220}, 167, 896), {5240, 1.400, 1.97, 1.5})},
    CatalogEntry{
        "aluminium_2024_t4",
        "strength: Steinberg, Cochran, Guinan 1980 and Steinberg's tables, shock and melting too; heat: ASM typical "
        "values (k 121 at 25 C, c 875 at 100 C)",
        with(metal(2785, {28.6, 260, 0.76, 310, 0.185, 6.52e-11, 6.16e-4, 1220}, 121, 875), {5328, 1.338, 2.00, 1.5})},
    CatalogEntry{
        "steel_304",
        "strength: Steinberg, Cochran, Guinan 1980 and Steinberg's tables, shock and melting too; heat: ASM typical "
        "values (k 16.2 at 100 C, c 500 for 0-100 C)",
        with(metal(7900, {77.0, 340, 2.5, 43, 0.35, 2.26e-11, 4.55e-4, 2380}, 16.2, 500), {4570, 1.490, 1.93, 1.4})},
    CatalogEntry{
        "aluminium_1100_o",
        "strength: Steinberg, Cochran, Guinan 1980 and Steinberg's tables, shock and melting too; heat: Aluminum "
        "Association typical values (k 222, c 904)",
        with(metal(2707, {27.1, 40, 0.48, 400, 0.27, 6.52e-11, 6.16e-4, 1220}, 222, 904), {5386, 1.339, 1.97, 1.5})},
    CatalogEntry{"aluminium_7075_t6",
                 "strength and T_melt: Steinberg, Cochran, Guinan 1980 and Steinberg's tables; heat: Aluminum "
                 "Association typical values (k 130, c 960)",
                 metal(2804, {26.7, 420, 0.81, 965, 0.10, 6.52e-11, 6.16e-4, 1220}, 130, 960)},
    CatalogEntry{"aluminium_5083",
                 "strength: our fit to the compression curves of Gray et al. 1994 at 1e-3 to 3000 1/s, 298 and 373 K "
                 "(3.6 % rms; tests/validation/curves); the temper is not told; heat: Aluminum Association typical "
                 "values (k 117, c 900); shock: Steinberg's tables, 6061-T6",
                 with(metal(2660, 26.7, JohnsonCookConstants{239.7, 408.8, 0.4882, 0.01944, 1.347, 893}, 117, 900),
                      {5240, 1.400, 1.97, 1.5})},
    CatalogEntry{
        "copper_ofhc",
        "half hard; strength: Steinberg's tables (UCRL-MA-106439, 1996), shock and melting too; heat: Incropera table "
        "A.1, pure copper at 300 K (k 401, c 385)",
        with(metal(8930, {47.7, 120, 0.64, 36, 0.45, 2.83e-11, 3.77e-4, 1790}, 401, 385), {3940, 1.489, 2.02, 1.5})},
    CatalogEntry{
        "silver",
        "strength: Steinberg's tables (UCRL-MA-106439, 1996), shock and melting too; heat: Incropera table A.1 at 300 "
        "K (k 429, c 235)",
        with(metal(10490, {29.8, 50, 0.66, 28, 0.80, 4.70e-11, 4.36e-4, 1604}, 429, 235), {3270, 1.550, 2.40, 1.8})},
    CatalogEntry{"titanium",
                 "strength and T_melt: Steinberg's tables (UCRL-MA-106439, 1996); its Hugoniot is not straight, so no "
                 "constants of compression; heat: Incropera table A.1 at 300 K (k 21.9, c 522)",
                 metal(4510, {43.4, 850, 1.45, 210, 0.10, 1.15e-11, 6.22e-4, 2260}, 21.9, 522)},
    CatalogEntry{
        "titanium_6al_4v",
        "strength and T_melt, shock and melting too: the set for Ti-6Al-4V of the Uintah code (University of Utah), "
        "after Steinberg's tables (UCRL-MA-106439, 1996); heat: ASM typical values, grade 5, annealed (k 6.7, c 526.3)",
        with(metal(4419, {41.9, 1330, 2.12, 12, 0.10, 1.15e-11, 6.44e-4, 2110}, 6.7, 526.3), {5130, 1.028, 1.23, 1.0})},
    CatalogEntry{
        "tantalum",
        "strength: Steinberg, Cochran, Guinan 1980 and Steinberg's tables, shock and melting too; heat: Incropera "
        "table A.1 at 300 K (k 57.5, c 140)",
        with(metal(16690, {69.0, 770, 1.10, 10, 0.10, 1.45e-11, 1.3e-4, 4340}, 57.5, 140), {3410, 1.200, 1.67, 1.3})},
    CatalogEntry{"steel_4340",
                 "strength and T_melt: the set for 4340 of the Uintah code (University of Utah), after Steinberg; it "
                 "prints Y_max 0.25 GPa, below its Y0, which is read as 2.5 GPa, as in Steinberg's Vascomax 250, whose "
                 "beta and n it has; density, c: Johnson, Cook 1983; k: ASM typical value at 100 C (44.5)",
                 metal(7830, {81.8, 1150, 2.5, 2.0, 0.50, 2.06e-11, 1.6e-4, 2310}, 44.5, 477)},
    CatalogEntry{"copper_ofhc_jc",
                 "strength, density, c, T_melt: Johnson, Cook 1983; G0: Steinberg's tables, OFHC; k: Incropera table "
                 "A.1, pure copper at 300 K (401)",
                 metal(8960, 47.7, {90, 292, 0.31, 0.025, 1.09, 1356}, 401, 383)},
    CatalogEntry{"brass_cartridge_jc",
                 "strength, density, c, T_melt: Johnson, Cook 1983; G0: ASM, C26000 (40 GPa); k: Incropera table A.1, "
                 "cartridge brass at 300 K (110)",
                 metal(8520, 40.0, {112, 505, 0.42, 0.009, 1.68, 1189}, 110, 385)},
    CatalogEntry{"nickel_200_jc",
                 "strength, density, c, T_melt: Johnson, Cook 1983; G0 and k: Special Metals, nickel 200 at room "
                 "temperature (81 GPa, 70)",
                 metal(8900, 81.0, {163, 648, 0.33, 0.006, 1.44, 1726}, 70, 446)},
    CatalogEntry{"iron_armco_jc",
                 "strength, density, c, T_melt: Johnson, Cook 1983; G0: CRC Handbook, polycrystalline iron (81.6 GPa); "
                 "k: Incropera table A.1, Armco iron at 300 K (72.7)",
                 metal(7890, 81.6, {175, 380, 0.32, 0.060, 0.55, 1811}, 72.7, 452)},
    CatalogEntry{"steel_1006_jc",
                 "strength, density, c, T_melt: Johnson, Cook 1983; G0: ASM, carbon steels (80 GPa); k: Incropera "
                 "table A.1, AISI 1010 at 300 K (63.9)",
                 metal(7890, 80.0, {350, 275, 0.36, 0.022, 1.00, 1811}, 63.9, 452)},
    CatalogEntry{"aluminium_2024_t351_jc",
                 "strength, density, c, T_melt: Johnson, Cook 1983; G0: Steinberg's tables, 2024; k: ASM typical value "
                 "at 25 C (121)",
                 metal(2770, 28.6, {265, 426, 0.34, 0.015, 1.00, 775}, 121, 875)},
    CatalogEntry{"steel_4340_jc",
                 "strength, density, c, T_melt: Johnson, Cook 1983; G0: E/(2 (1 + nu)) of 200 GPa and 0.29; k: ASM "
                 "typical value at 100 C (44.5)",
                 metal(7830, 77.5, {792, 510, 0.26, 0.014, 1.03, 1793}, 44.5, 477)},
    CatalogEntry{"copper_ofhc_ptw",
                 "strength, G0 (0 K), alpha, T_melt: the set for copper of the F_UNCLE code (Los Alamos), after "
                 "Preston, Tonks, Wallace 2003 (the paper itself was not read); the same strength stands in the tests "
                 "of the impala code (Los Alamos), M too; density, gP, shock and melting: Steinberg's tables, OFHC; "
                 "heat: Incropera table A.1, pure copper at 300 K (k 401, c 385)",
                 with(metal(8930,
                            {51.8, 0.20, 0.025, 2.0, 0.0085, 0.00055, 0.11, 1e-5, 1e-4, 1e-4, 0.094, 0.575, 0.25,
                             63.546, 1358.03},
                            2.83e-11, 401, 385),
                      {3940, 1.489, 2.02, 1.5})},
};

bool have_same_strength(const Material& a, const Material& b) {
  return a.flow_law == b.flow_law && a.melting_temperature == b.melting_temperature &&
         FlowLaws::with(a.flow_law, [&](auto own) {
           return std::ranges::all_of(decltype(own)::type::kConstants,
                                      [&](auto constant) { return a.*constant == b.*constant; });
         });
}

}  // namespace

std::span<const CatalogEntry> catalog() {
  return kCatalog;
}

std::string_view caution_of(std::string_view name, const Material& material) {
  if (name != "titanium_6al_4v") return {};
  const auto entry = std::ranges::find(kCatalog, name, &CatalogEntry::name);
  if (!have_same_strength(entry->material, material)) return {};
  return "its strength agrees with measurements from 295 K (5.9 % rms); measured at 1173 K the metal is 35 % weaker, "
         "so that the stress of a hot interface is an upper bound";
}

}  // namespace shearbus::physics
