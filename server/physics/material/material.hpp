// A metal: constants of its strength (flow_laws.hpp has the laws they belong to), of heat and of compression.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace shearbus::physics {

enum class MeltingCurve { kConstant, kLindemann, kSimon };  // T_melt is constant, or rises with P
enum class PressureTerm { kLinear, kCompressed };           // pressure term of g(P, T): gP P, or gP P / eta^(1/3)

enum class FlowLaw : std::uint8_t {};  // place in the list of flow_laws.hpp

inline constexpr double kNotGiven = std::numeric_limits<double>::quiet_NaN();

struct Material {
  double density = 0.0;                                                 // rho   [kg/m3]
  double shear_modulus = 0.0;                                           // G0    [Pa]
  double yield_strength = 0.0;                                          // Y0, Johnson-Cook: A  [Pa]
  double yield_strength_max = std::numeric_limits<double>::infinity();  // Y_max [Pa]; infinity: no cap (DLP 40)
  double hardening_coefficient = 0.0;                                   // beta in (1 + beta ep)^n  [1]
  double hardening_exponent = 0.0;                                      // n, exponent of hardening  [1]
  double pressure_coefficient = 0.0;                                    // gP, factor of P in the softening g  [1/Pa]
  double temperature_coefficient = 0.0;  // hT, coefficient of -(T - 300 K) in the softening g  [1/K]
  double melting_temperature = 0.0;      // T_melt [K]
  double conductivity = 0.0;             // k     [W/(m K)]
  double specific_heat = 0.0;            // c     [J/(kg K)]
  double diffusivity = 0.0;  // alpha [m2/s]; rho c in the heat equation is k/alpha, never density * specific_heat
  // k(T) = k (1 + a (T - 300 K)) and c(T) likewise; not given: constant  [1/K]
  double conductivity_slope = kNotGiven;
  double specific_heat_slope = kNotGiven;

  // Constants that only Johnson and Cook's law uses (johnson_cook.hpp).
  double hardening_modulus = kNotGiven;      // B, in the strength A + B ep^n  [Pa]
  double rate_coefficient = kNotGiven;       // C, factor of ln(strain rate / r0)  [1]
  double reference_strain_rate = kNotGiven;  // r0, plastic strain rate up to which the rate has no effect  [1/s]
  double thermal_exponent = kNotGiven;       // m, exponent of T* in the softening 1 - T*^m  [1]
  double reference_temperature = kNotGiven;  // T_ref, temperature up to which the metal does not soften  [K]

  // Constants that only Preston, Tonks and Wallace's law uses (preston_tonks_wallace.hpp). Stresses are in units of
  // twice the shear modulus G; r is the plastic strain rate over the attempt rate.
  double molar_mass = kNotGiven;                // mass of one mole of atoms  [kg/mol]
  double work_hardening_rate = kNotGiven;       // theta, slope of stress/(2G) over strain at zero plastic strain  [1]
  double work_hardening_curvature = kNotGiven;  // p, curvature of the hardening curve; 0: Voce's law  [1]
  double saturation_cold = kNotGiven;           // s0, saturation stress over twice the shear modulus, at T = 0  [1]
  double saturation_hot = kNotGiven;            // s_inf, saturation stress over twice the shear modulus, at high T  [1]
  double yield_cold = kNotGiven;                // y0, yield stress over twice the shear modulus, at T = 0  [1]
  double yield_hot = kNotGiven;                 // y_inf, yield stress over twice the shear modulus, at high T  [1]
  double activation = kNotGiven;                // kappa, factor of (T/T_melt) ln(1/strain rate r) in the softening  [1]
  double attempt_rate = kNotGiven;              // gamma, attempt rate over the rate of a shear wave across an atom  [1]
  double medium_rate_yield = kNotGiven;         // y1, factor of the yield stress y1 r^y2 at medium strain rates r  [1]
  double medium_rate_exponent = kNotGiven;  // y2, exponent of the yield stress y1 r^y2 at medium strain rates r  [1]
  double overdriven_exponent = kNotGiven;   // beta, exponent of the stress s0 r^beta at the highest strain rates r  [1]
  double modulus_temperature = kNotGiven;   // alpha in G = G0 (1 - alpha T/T_melt)  [1]

  // Compression and melting under pressure, as Steinberg tabulates them; needed only by the Lindemann melting_curve and
  // by pressure_term.
  double sound_speed = kNotGiven;        // c0 of the Hugoniot U = c0 + s u  [m/s]
  double hugoniot_slope = kNotGiven;     // s of the Hugoniot U = c0 + s u  [1]
  double grueneisen = kNotGiven;         // Grueneisen's gamma0  [1]
  double volume_correction = kNotGiven;  // first-order volume correction a of gamma0  [1]

  // Constants of Simon's melting curve T0 (1 + P/a)^(1/c); needed only by that melting_curve.
  double simon_temperature = kNotGiven;  // T0, melting temperature at rest  [K]
  double simon_pressure = kNotGiven;     // a  [Pa]
  double simon_exponent = kNotGiven;     // c  [1]

  FlowLaw flow_law{};  // place of the law in flow_laws.hpp; 0: Steinberg-Cochran-Guinan
  MeltingCurve melting_curve = MeltingCurve::kConstant;
  PressureTerm pressure_term = PressureTerm::kLinear;

  // Share of k or c that is left at a temperature, at least kLeastHeatShare.
  static constexpr double kLeastHeatShare = 0.05;
  double conductivity_share(double T) const { return share_at(conductivity_slope, T); }
  double heat_share(double T) const { return share_at(specific_heat_slope, T); }
  bool conducts_by_temperature() const { return varies(conductivity_slope) || varies(specific_heat_slope); }

  bool varies_with_compression() const {
    return melting_curve != MeltingCurve::kConstant || pressure_term != PressureTerm::kLinear;
  }

 private:
  static constexpr double kHeatReference = 300.0;  // temperature at which k and c are those of the table  [K]
  static bool varies(double slope) { return slope == slope && slope != 0.0; }
  static double share_at(double slope, double T) {
    const double share = varies(slope) ? 1.0 + slope * (T - kHeatReference) : 1.0;
    return share > kLeastHeatShare ? share : kLeastHeatShare;
  }
};

// Chooses the melting curve. With Simon's curve the melting temperature of the material becomes that of the curve at
// rest, if the material has its constants.
void choose_melting_curve(Material& material, MeltingCurve curve);

// A constant of a material and its name in scenes. Overrides, effective scenes and messages all use this table.
struct MaterialField {
  std::string_view name;  // key in scenes, for example "yield_strength_pa"
  double Material::*value;
  bool required;     // true: a material must have this constant if its law uses it
  bool may_be_zero;  // false: the constant must be above 0
  bool may_be_negative = false;
};
std::span<const MaterialField> material_fields();

struct CatalogEntry {
  std::string_view name;
  std::string_view source;  // source of every number of the material
  Material material;
};
std::span<const CatalogEntry> catalog();

// Makes a material from the catalog's material `name`, or from no constants if `name` is empty; the constants in
// `given` replace those of the catalog. `law`: a flow law in place of the catalog's; all constants that this law
// requires must then be given. The material cannot be made if the name is unknown, if a constant is unknown, missing,
// of another law, not finite or out of its range, or if constants contradict each other. `fault` then says why, and
// `fault_field` is "material" or the name of the constant. Otherwise both are empty.
struct MaterialResult {
  Material material;
  std::string fault_field;
  std::string fault;
};
MaterialResult make_material(std::string_view name, std::span<const std::pair<std::string, double>> given,
                             std::optional<FlowLaw> law = {});

// Name of the first constant that the material lacks although its melting_curve or pressure_term needs it; empty: none.
std::string_view constant_missing_for_options(const Material& material);

// (name, value) of every finite constant of the material, without the strength constants of other laws, as an effective
// scene lists them.
std::vector<std::pair<std::string, double>> constants_of(const Material& material);

}  // namespace shearbus::physics
