#include "server/physics/material/material.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "server/physics/material/compression.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/text.hpp"

namespace shearbus::physics {
namespace {

constexpr std::array kFields = {
    MaterialField{"density_kg_per_m3", &Material::density, true, false},
    MaterialField{"shear_modulus_pa", &Material::shear_modulus, true, false},
    MaterialField{"yield_strength_pa", &Material::yield_strength, true, false},
    MaterialField{"yield_strength_max_pa", &Material::yield_strength_max, false, false},
    MaterialField{"hardening_coefficient", &Material::hardening_coefficient, true, true},
    MaterialField{"hardening_exponent", &Material::hardening_exponent, true, false},
    MaterialField{"pressure_coefficient_per_pa", &Material::pressure_coefficient, true, true},
    MaterialField{"temperature_coefficient_per_k", &Material::temperature_coefficient, true, true},
    MaterialField{"melting_temperature_k", &Material::melting_temperature, true, false},
    MaterialField{"thermal_conductivity_w_per_m_k", &Material::conductivity, true, false},
    MaterialField{"specific_heat_j_per_kg_k", &Material::specific_heat, true, false},
    MaterialField{"thermal_diffusivity_m2_per_s", &Material::diffusivity, false, false},
    MaterialField{"hardening_modulus_pa", &Material::hardening_modulus, true, false},
    MaterialField{"rate_coefficient", &Material::rate_coefficient, true, true},
    MaterialField{"reference_strain_rate_per_s", &Material::reference_strain_rate, true, false},
    MaterialField{"thermal_softening_exponent", &Material::thermal_exponent, true, false},
    MaterialField{"reference_temperature_k", &Material::reference_temperature, true, false},
    MaterialField{"molar_mass_kg_per_mol", &Material::molar_mass, true, false},
    MaterialField{"work_hardening_rate", &Material::work_hardening_rate, true, false},
    MaterialField{"work_hardening_curvature", &Material::work_hardening_curvature, true, true},
    MaterialField{"saturation_stress_cold", &Material::saturation_cold, true, false},
    MaterialField{"saturation_stress_hot", &Material::saturation_hot, true, false},
    MaterialField{"yield_stress_cold", &Material::yield_cold, true, false},
    MaterialField{"yield_stress_hot", &Material::yield_hot, true, false},
    MaterialField{"activation_coefficient", &Material::activation, true, false},
    MaterialField{"attempt_rate_coefficient", &Material::attempt_rate, true, false},
    MaterialField{"medium_rate_yield_coefficient", &Material::medium_rate_yield, true, false},
    MaterialField{"medium_rate_yield_exponent", &Material::medium_rate_exponent, true, false},
    MaterialField{"overdriven_exponent", &Material::overdriven_exponent, true, false},
    MaterialField{"modulus_temperature_coefficient", &Material::modulus_temperature, true, true},
    MaterialField{"sound_speed_m_per_s", &Material::sound_speed, false, false},
    MaterialField{"hugoniot_slope", &Material::hugoniot_slope, false, false},
    MaterialField{"grueneisen_coefficient", &Material::grueneisen, false, false},
    MaterialField{"grueneisen_volume_correction", &Material::volume_correction, false, true},
    MaterialField{"simon_temperature_k", &Material::simon_temperature, false, false},
    MaterialField{"simon_pressure_pa", &Material::simon_pressure, false, false},
    MaterialField{"simon_exponent", &Material::simon_exponent, false, false},
    MaterialField{"thermal_conductivity_slope_per_k", &Material::conductivity_slope, false, true, true},
    MaterialField{"specific_heat_slope_per_k", &Material::specific_heat_slope, false, true, true},
};

bool is_strength(double Material::*constant) {
  return FlowLaws::any(
      [&](auto each) { return has_constant(FlowLaws::place<typename decltype(each)::type>(), constant); });
}

// Whether a material with this law has the constant: true for a strength constant that the law uses, and for every
// constant that is not a strength constant of any law.
bool belongs(double Material::*constant, FlowLaw law) {
  return !is_strength(constant) || has_constant(law, constant);
}

// Number of single-letter edits between two words (Levenshtein).
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row[b.size()];
}

MaterialResult failed(std::string_view field, std::string fault) {
  return {{}, std::string(field), std::move(fault)};
}

std::string quoted(std::string_view text) {
  std::string result(text);
  result.insert(result.begin(), '"');
  result.push_back('"');
  return result;
}

// Asks whether the nearest name was meant, or those that begin with `name`; empty if none can have been.
template <class Range>
std::string did_you_mean(std::string_view name, const Range& range) {
  const std::string_view near = std::min_element(range.begin(), range.end(), [&](const auto& a, const auto& b) {
                                  return edit_distance(name, a.name) < edit_distance(name, b.name);
                                })->name;
  const std::size_t most = std::max<std::size_t>(1, std::max(name.size(), near.size()) / 3);
  if (edit_distance(name, near) <= most) return "; did you mean " + quoted(near) + "?";
  std::string longer;
  for (const auto& one : range)
    if (!name.empty() && one.name.starts_with(name)) longer += (longer.empty() ? "" : " or ") + quoted(one.name);
  return longer.empty() ? "" : "; did you mean " + longer + "?";
}

std::string all_names() {
  std::string names;
  for (const CatalogEntry& entry : catalog()) names.append(names.empty() ? "" : ", ").append(entry.name);
  return names;
}

// The fault of a constant's value; empty: none.
std::string value_fault(const MaterialField& field, double value) {
  if (!std::isfinite(value)) return text_of("expected a finite number, found ", value);
  if (field.may_be_negative || (field.may_be_zero ? value >= 0.0 : value > 0.0)) return {};
  return text_of("expected a number ", field.may_be_zero ? "not below 0" : "above 0", ", found ", value);
}

}  // namespace

std::span<const MaterialField> material_fields() {
  return kFields;
}

MaterialResult make_material(std::string_view name, std::span<const std::pair<std::string, double>> given,
                             std::optional<FlowLaw> law) {
  // 1. The constants start from those of the catalog's material `name`, or from no values if no name is given.
  Material material;
  if (!name.empty()) {
    const auto entries = catalog();
    const auto entry = std::find_if(entries.begin(), entries.end(), [&](const auto& e) { return e.name == name; });
    if (entry == entries.end()) {
      return failed("material",
                    quoted(name) + " is not in the catalog (" + all_names() + ")" + did_you_mean(name, entries));
    }
    material = entry->material;
  }
  // If the caller chooses another flow law than the catalog's, the catalog's strength constants mean nothing. The
  // caller must then give all strength constants that the chosen law requires.
  const bool other_law = law && *law != material.flow_law;
  if (law) material.flow_law = *law;

  // 2. The constants given by the caller replace those of the catalog.
  std::array<bool, kFields.size()> is_given{};
  for (const auto& [key, value] : given) {
    const auto field =
        std::find_if(kFields.begin(), kFields.end(), [&key = key](const auto& f) { return f.name == key; });
    if (field == kFields.end()) {
      return failed(key, quoted(key) + " is not a constant of a material" + did_you_mean(key, kFields));
    }
    if (!belongs(field->value, material.flow_law)) {
      return failed(key, quoted(key) +
                             " is not a constant of flow_law = " + quoted(FlowLaws::name_of(material.flow_law)) +
                             ", which this material follows: leave it out, or choose the law it belongs to");
    }
    if (std::string fault = value_fault(*field, value); !fault.empty()) return failed(key, std::move(fault));
    material.*(field->value) = value;
    is_given[static_cast<std::size_t>(field - kFields.begin())] = true;
  }
  const auto overridden = [&](double Material::*member) {
    const auto field = std::find_if(kFields.begin(), kFields.end(), [&](const auto& f) { return f.value == member; });
    return is_given[static_cast<std::size_t>(field - kFields.begin())];
  };

  // 3. No required constant may be missing.
  for (std::size_t i = 0; i < kFields.size(); ++i) {
    const bool of_law = belongs(kFields[i].value, material.flow_law);
    const bool from_catalog = !name.empty() && !(other_law && is_strength(kFields[i].value));
    if (!of_law || from_catalog || is_given[i]) continue;
    if (!kFields[i].required) {
      material.*(kFields[i].value) = Material{}.*(kFields[i].value);
    } else if (name.empty()) {
      return failed(kFields[i].name, "missing: give it, or name a material of the catalog (" + all_names() + ")");
    } else {
      return failed(kFields[i].name, "missing: the catalog has no constants of flow_law = " +
                                         quoted(FlowLaws::name_of(material.flow_law)) + " for " + quoted(name));
    }
  }
  if (material.hardening_exponent > 1.0) {
    return failed("hardening_exponent", text_of("expected at most 1, found ", material.hardening_exponent));
  }

  const LawFault law_fault =
      FlowLaws::with(material.flow_law, [&](auto own) { return decltype(own)::type::fault_of(material); });
  if (!law_fault.field.empty()) return failed(law_fault.field, std::string(law_fault.text));

  // 4. Sets a diffusivity that agrees with the other heat constants. The diffusivity of the catalog (which need not be
  //    exactly k/(rho c)) stays only while conductivity, density and specific heat are those of the catalog too.
  const bool other_heat = name.empty() || overridden(&Material::conductivity) || overridden(&Material::density) ||
                          overridden(&Material::specific_heat);
  if (!overridden(&Material::diffusivity) && (other_heat || material.diffusivity == 0.0)) {
    material.diffusivity = material.conductivity / (material.density * material.specific_heat);
  }
  return {material, {}, {}};
}

std::string_view constant_missing_for_options(const Material& material) {
  const double Material::*compression[] = {&Material::sound_speed, &Material::hugoniot_slope};
  const double Material::*lindemann[] = {&Material::grueneisen, &Material::volume_correction};
  const double Material::*simon[] = {&Material::simon_temperature, &Material::simon_pressure,
                                     &Material::simon_exponent};
  std::string_view missing;
  const auto need = [&](std::span<const double Material::*const> members) {
    for (const double Material::*member : members) {
      const auto field = std::find_if(kFields.begin(), kFields.end(), [&](const auto& f) { return f.value == member; });
      if (missing.empty() && !std::isfinite(material.*member)) missing = field->name;
    }
  };
  const bool has_pressure_term = has_constant(material.flow_law, &Material::pressure_coefficient);
  const bool compressed = material.pressure_term != PressureTerm::kLinear && has_pressure_term;
  if (compressed || material.melting_curve == MeltingCurve::kLindemann) need(compression);
  if (material.melting_curve == MeltingCurve::kLindemann) need(lindemann);
  if (material.melting_curve == MeltingCurve::kSimon) need(simon);
  return missing;
}

void choose_melting_curve(Material& material, MeltingCurve curve) {
  material.melting_curve = curve;
  if (curve == MeltingCurve::kSimon && std::isfinite(material.simon_temperature))
    material.melting_temperature = material.simon_temperature;
}

double compression_at(const Material& m, double pressure) {
  return pressure > 0.0 ? compression::eta_at(m, pressure) : 1.0;
}

Material at_pressure(const Material& m, double pressure) {
  Material now = m;
  if (!m.varies_with_compression()) return now;
  if (m.melting_curve == MeltingCurve::kSimon) {
    now.melting_temperature = compression::simon_temperature(m, pressure);
    now.melting_curve = MeltingCurve::kConstant;
  }
  if (!now.varies_with_compression()) return now;
  const double eta = compression_at(m, pressure);
  if (m.melting_curve == MeltingCurve::kLindemann) {
    now.melting_temperature = compression::lindemann_temperature(m, eta);
    now.melting_curve = MeltingCurve::kConstant;
  }
  if (m.pressure_term == PressureTerm::kCompressed) {
    now.pressure_coefficient = compression::compressed_pressure_coefficient(m, eta);
    now.pressure_term = PressureTerm::kLinear;
  }
  return now;
}

std::vector<std::pair<std::string, double>> constants_of(const Material& material) {
  std::vector<std::pair<std::string, double>> constants;
  for (const MaterialField& field : kFields) {
    if (!belongs(field.value, material.flow_law)) continue;
    if (std::isfinite(material.*(field.value))) constants.emplace_back(field.name, material.*(field.value));
  }
  return constants;
}

double heat_partition(const Material& soft, const Material& hard) {
  const double into_soft = soft.conductivity * std::sqrt(hard.diffusivity);
  return into_soft / (into_soft + hard.conductivity * std::sqrt(soft.diffusivity));
}

}  // namespace shearbus::physics
