#include "server/physics/solver/parts.hpp"

#include <cmath>
#include <utility>
#include <vector>

#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/solver/option_limits.hpp"
#include "server/physics/solver/parts_table.hpp"
#include "server/physics/solver/text.hpp"

namespace shearbus::physics {
namespace {

constexpr const Part& part_of_table(Property property) {
  return kParts[static_cast<std::size_t>(property)];
}

constexpr const Exclusion* exclusion_of(Property a, Property b, std::span<const Exclusion> exclusions) {
  for (const Exclusion& e : exclusions)
    if ((e.first.has(a) && e.second.has(b)) || (e.first.has(b) && e.second.has(a))) return &e;
  return nullptr;
}

constexpr bool alternatives(Property a, Property b) {
  for (const Properties& choice : kChoices)
    if (a != b && choice.has(a) && choice.has(b)) return true;
  return false;
}

// Calls `with` for each property that is surely on where `of` is, `of` among them, until a call returns true.
template <class With>
constexpr bool any_needed(Property of, const With& with) {
  if (with(of)) return true;
  for (int p = 0; p < kProperties; ++p) {
    const auto needed = static_cast<Property>(p);
    if (static_cast<int>(of) < kProperties && part_of_table(of).needs.has(needed) && with(needed)) return true;
  }
  return false;
}

// Whether the tables rule out a model with both properties: they or what they need are alternatives or exclude each
// other, or of a choice that every model has to make each part is ruled out by one of them.
constexpr bool never_meet(Property a, Property b, std::span<const Exclusion> exclusions) {
  const auto apart = [&](Property of_a, Property of_b) {
    return any_needed(of_a, [&](Property x) {
      return any_needed(of_b,
                        [&](Property y) { return alternatives(x, y) || exclusion_of(x, y, exclusions) != nullptr; });
    });
  };
  if (apart(a, b)) return true;
  for (std::size_t c = 0; c < kWholeChoices; ++c) {
    bool ruled_out = true;
    for (int p = 0; p < kProperties; ++p) {
      const auto part = static_cast<Property>(p);
      if (kChoices[c].has(part) && !apart(a, part) && !apart(b, part)) ruled_out = false;
    }
    if (ruled_out) return true;
  }
  return false;
}

// Whether the tables say for every two parts if a model may have both: either the later part lists the earlier one in
// `goes_with`, or the pair is excluded (but not both), or no allowed model can have both (and then no row may say so).
constexpr bool every_pair_is_decided(std::span<const Part> rows, std::span<const Exclusion> exclusions) {
  for (std::size_t j = 0; j < rows.size(); ++j) {
    for (std::size_t i = 0; i < j; ++i) {
      const Property a = rows[i].property, b = rows[j].property;
      const bool excluded = exclusion_of(a, b, exclusions) != nullptr;
      const bool listed = rows[j].goes_with.has(a);
      if (excluded && listed) return false;
      if (!excluded && !listed && !never_meet(a, b, exclusions)) return false;
    }
  }
  return true;
}
static_assert(every_pair_is_decided(kParts, kExclusions));

// Whether the cost of every option has been measured.
constexpr bool every_option_has_its_cost(std::span<const Part> rows) {
  for (const Part& row : rows)
    if (row.set != nullptr && row.cost.empty()) return false;
  return true;
}
static_assert(every_option_has_its_cost(kParts), "tests/bench/option_costs.py measures the cost of an option");

std::string all_texts(const std::vector<Refusal>& refusals) {
  std::string all;
  for (const Refusal& r : refusals) all += (all.empty() ? "" : "\n") + r.text;
  return all;
}

}  // namespace

std::span<const Part> parts() {
  return kParts;
}
const Part& part_of(Property property) {
  return part_of_table(property);
}
std::string unique_key(const Part& part) {
  std::string name(part.key);
  for (const Part& earlier : kParts) {
    if (earlier.property >= part.property) break;
    if (earlier.set != nullptr && earlier.key == part.key) return name + " = " + std::string(part.value);
  }
  return name;
}
std::string_view key_of(const Part& part, const ModelOptions& options) {
  const bool forced = options.strategy == Strategy::kForceDriven;
  const auto given = [](double slope) { return std::isfinite(slope) && slope != 0.0; };
  if (part.property == kVaryingHeat && conducts_by_temperature(options)) {
    if (!options.soft.conducts_by_temperature())
      for (const HeatTableKeys& keys : kHeatTables)
        if (!(heat_tables(options).*keys.table).empty()) return keys.values;
    const bool of_soft = options.soft.conducts_by_temperature();
    const bool conducts = given((of_soft ? options.soft : options.hard).conductivity_slope);
    if (of_soft) return conducts ? part.key : "soft.specific_heat_slope_per_k";
    return conducts ? "hard.thermal_conductivity_slope_per_k" : "hard.specific_heat_slope_per_k";
  }
  return part.property == kPlasticHeating && forced ? "interface.taylor_quinney_factor" : part.key;
}
std::string setting_of(const Part& part, const ModelOptions& options) {
  std::string key(key_of(part, options));
  if (part.property == kFixedHeatShare) return "no table [" + key + "]";
  if (part.property == kFlowingLayer)
    return setting_of(part_of(options.plastic_layer ? kPlasticLayer : kVelocityDriven), options);
  if (part.property == kCoulombLimit || part.property == kPlasticHeating || part.property == kTolerance ||
      part.property == kVaryingHeat)
    return key;
  if (!part.value.empty()) return key + " = " + std::string(part.value);
  if (key == "interface.friction_law")
    return key + " = \"" + std::string(FrictionLaws::name_of(options.interface.friction_law)) + "\"";
  if (key == "soft.flow_law") return key + " = \"" + std::string(FlowLaws::name_of(options.soft.flow_law)) + "\"";
  return "[" + key + "]";
}

std::string name_of(const Part& part, const ModelOptions& options) {
  if (part.property == kFlowingLayer) return "a layer that flows";
  return part.law_with.empty() ? setting_of(part, options) : text_of("a ", part.law_with);
}

std::span<const Exclusion> exclusions() {
  return kExclusions;
}
std::span<const Properties> choices() {
  return kChoices;
}

bool go_together(const Part& a, const Part& b, std::span<const Exclusion> exclusions) {
  if (exclusion_of(a.property, b.property, exclusions) != nullptr) return false;
  return (a.property < b.property ? b : a).goes_with.has((a.property < b.property ? a : b).property);
}

std::vector<Refusal> refusals(const ModelOptions& options, std::span<const Part> parts,
                              std::span<const Exclusion> exclusions) {
  std::vector<Refusal> found;
  // What a scene does without a part: it has one strategy, and a law of each kind.
  const auto without = [&](const Part& part) {
    if (!part.law_with.empty()) return text_of("take another ", part.key);
    if (part.property == kVelocityDriven || part.property == kForceDriven ||
        (part.property == kFlowingLayer && !options.plastic_layer))
      return std::string("take the other strategy");
    return "leave out " + setting_of(part, options);
  };
  const auto refuse = [&](const Part& named, const Part& other, std::string_view reason) {
    if (other.property == kFixedHeatShare) {
      const std::string setting = setting_of(named, options), table = text_of("[", key_of(other, options), "]");
      found.push_back({std::string(key_of(named, options)), text_of(setting, " needs ", table, ": ", reason),
                       text_of("Give ", table, ", or leave out ", setting, ".")});
      return;
    }
    std::string remedy = text_of(without(named), ", or ", without(other), ".");
    remedy.front() = remedy.front() == 'l' ? 'L' : 'T';
    found.push_back(
        {std::string(key_of(named, options)),
         setting_of(named, options) + " does not go with " + setting_of(other, options) + ": " + std::string(reason),
         std::move(remedy)});
  };
  std::vector<const Part*> on;
  for (const Part& part : parts)
    if (part.is_on(options)) on.push_back(&part);
  for (std::size_t j = 0; j < on.size(); ++j) {
    for (std::size_t i = 0; i < j; ++i) {
      const Part &earlier = *on[i], &later = *on[j];
      if (const Exclusion* e = exclusion_of(earlier.property, later.property, exclusions)) {
        e->first.has(later.property) ? refuse(later, earlier, e->reason) : refuse(earlier, later, e->reason);
      } else if (!go_together(earlier, later, exclusions) &&
                 !never_meet(earlier.property, later.property, exclusions)) {
        refuse(later, earlier, "nothing is known of the two together");
      }
    }
  }
  for (const Part* part : on) {
    if (part->property == kPlasticHeating || part->property == kInertia)
      continue;  // option_limits.cpp says it with the reason
    for (const Part& needed : parts) {
      if (!part->needs.has(needed.property) || needed.is_on(options)) continue;
      found.push_back({std::string(key_of(*part, options)),
                       text_of(setting_of(*part, options), " is an option of ", name_of(needed, options)),
                       text_of("Leave it out, or take ", name_of(needed, options), ".")});
    }
  }
  add_refused_values(options, found);
  return found;
}

Properties properties_of(const ModelOptions& options) {
  Properties on;
  for (const Part& part : kParts)
    if (part.is_on(options)) on.add(part.property);
  return on;
}

bool only_open_is_second_order(const ModelOptions& options) {
  const bool rate_flows = options.strategy == Strategy::kVelocityDriven && !options.inertia &&
                          properties_of(options.soft.flow_law).first_order_in_time;
  const auto& law = options.interface.friction_law;
  return (options.plastic_layer && !options.inertia) || options.junctions || options.melt_film ||
         options.taylor_quinney_factor || rate_flows ||
         (has_friction(options) && (properties_of(law).depends_on_slip() || !states_of(law).empty()));
}

bool goes_with(Property property, const ModelOptions& options) {
  const Properties on = properties_of(options);
  for (const Part& part : kParts)
    if (part.property != property && on.has(part.property) && !go_together(part, part_of(property), kExclusions))
      return false;
  return true;
}

ModelOptions switched(ModelOptions options, const Part& part, bool on) {
  part.set(options, on);
  return options.tolerance ? discretised(options, *options.tolerance) : options;
}

RefusedOptions::RefusedOptions(std::vector<Refusal> found)
    : std::invalid_argument(all_texts(found)), refusals(std::move(found)) {}

}  // namespace shearbus::physics
