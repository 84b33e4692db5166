#include "server/physics/material/material.hpp"

#include <array>

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

// Shock and melting constants as Steinberg prints them: c0 [m/s], s, gamma0, a.
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

constexpr std::array kCatalog = {
    CatalogEntry{
        "aluminium_dlp",
        "DLP tables: SCG constants of 6061-T6 with Y0 lowered to 200 MPa, heat of Al 5083; alpha as printed (48.9e-6, "
        "not exactly k/(rho c)); no Y_max, as DLP (40); shock and melting: Steinberg's tables, 6061-T6",
        with(metal(2703, {27.6, 200, kNoCap, 125, 0.10, 6.52e-11, 6.16e-4, 1220}, {117, 900, 48.9e-6}),
             {5240, 1.400, 1.97, 1.5})},
    CatalogEntry{"steel_dlp",
                 "DLP tables: stainless steel; alpha as printed; no Y_max, as DLP (40); shock and melting: "
                 "Steinberg's tables, 304",
                 with(metal(7900, {77.0, 340, kNoCap, 43, 0.35, 2.26e-11, 4.55e-4, 2380}, {16.1, 500, 4.076e-6}),
                      {4570, 1.490, 1.93, 1.4})},
    CatalogEntry{
        "aluminium_6061_t6",
        "strength: Steinberg, Cochran, Guinan 1980 and Steinberg's tables, shock and melting too; heat: Aluminum "
        "Association typical "
        "values at "
        "room temperature (k 167, c 896)",
        with(metal(2703, {27.6, 290, 0.68, 125, 0.10, 6.52e-11, 6.16e-4, 1220}, 167, 896), {5240, 1.400, 1.97, 1.5})},
    CatalogEntry{
        "aluminium_2024_t4",
        "strength: Steinberg, Cochran, Guinan 1980 and Steinberg's tables, shock and melting too; heat: ASM typical "
        "values (k 121 at "
        "25 C, c 875 "
        "at 100 C)",
        with(metal(2785, {28.6, 260, 0.76, 310, 0.185, 6.52e-11, 6.16e-4, 1220}, 121, 875), {5328, 1.338, 2.00, 1.5})},
    CatalogEntry{
        "steel_304",
        "strength: Steinberg, Cochran, Guinan 1980 and Steinberg's tables, shock and melting too; heat: ASM typical "
        "values (k 16.2 "
        "at 100 C, c "
        "500 for 0-100 C)",
        with(metal(7900, {77.0, 340, 2.5, 43, 0.35, 2.26e-11, 4.55e-4, 2380}, 16.2, 500), {4570, 1.490, 1.93, 1.4})},
};

}  // namespace

std::span<const CatalogEntry> catalog() {
  return kCatalog;
}

}  // namespace shearbus::physics
