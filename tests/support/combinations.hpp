// Combinations of model options for tests. They are built from every option in the table of
// server/physics/solver/parts_table.hpp and from every flow law and friction law, so that a new option or law is tested
// without an edit here.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <optional>
#include <string>
#include <vector>

#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/parts.hpp"
#include "tests/support/invariants.hpp"

namespace shearbus::testing {

enum class Kind { kOption, kFlowLaw, kFrictionLaw };

struct Item {
  std::string name;
  std::function<void(ModelOptions&)> apply;
  Kind kind = Kind::kOption;
};

inline void follow_flow_law(Material& soft, FlowLaw law) {
  for (const CatalogEntry& entry : catalog()) {
    if (entry.material.flow_law != law) continue;
    const Material aluminium = soft;
    soft = entry.material;
    // Sound speed, slope of the Hugoniot, Grueneisen coefficient and volume correction give the compression at a
    // pressure. A metal of the catalog that lacks one of these constants gets the constant of aluminium.
    if (!std::isfinite(soft.sound_speed)) soft.sound_speed = aluminium.sound_speed;
    if (!std::isfinite(soft.hugoniot_slope)) soft.hugoniot_slope = aluminium.hugoniot_slope;
    if (!std::isfinite(soft.grueneisen)) soft.grueneisen = aluminium.grueneisen;
    if (!std::isfinite(soft.volume_correction)) soft.volume_correction = aluminium.volume_correction;
    return;
  }
  throw Broken(fmt::format("no material of the catalog follows {}", FlowLaws::name_of(law)));
}

// Returns a material with the heat and melting constants of the metal `heat` and all other constants of the metal
// `strength`.
inline Material with_strength_of(const Material& heat, Material strength) {
  strength.conductivity = heat.conductivity;
  strength.specific_heat = heat.specific_heat;
  strength.diffusivity = heat.diffusivity;
  strength.density = heat.density;
  strength.melting_temperature = heat.melting_temperature;
  strength.melting_curve = heat.melting_curve;
  return strength;
}

// Returns all laws and options. Laws come before options, because typical values of an option may depend on the
// material.
inline std::vector<Item> items() {
  std::vector<Item> all;
  for (int n = 2; const auto law = FlowLaws::numbered(n); ++n)
    all.push_back({std::string(FlowLaws::name_of(*law)),
                   [law = *law](ModelOptions& o) { follow_flow_law(o.soft, law); }, Kind::kFlowLaw});
  for (int n = 2; const auto law = FrictionLaws::numbered(n); ++n)
    all.push_back({std::string(FrictionLaws::name_of(*law)),
                   [law = *law](ModelOptions& o) {
                     o.interface = FrictionLaws::with(
                         law, [&](auto own) { return decltype(own)::type::typical(o.interface, o.soft); });
                     o.interface.friction_law = law;
                     if (o.strategy == Strategy::kVelocityDriven) o.friction_coefficient = 0.02;
                   },
                   Kind::kFrictionLaw});
  for (const Part& part : parts()) {
    if (part.set == nullptr) continue;
    all.push_back({unique_key(part), [&part](ModelOptions& o) { part.set(o, true); }});
  }
  return all;
}

// Options with one item on. Where the item alone is refused with `base`, a companion goes with it, which `without` has too:
// plastic heating, for example, needs the table [hard_layer].
struct WithItem {
  ModelOptions with, without;
  std::string companion;  // name of an item; empty: none
};

// Returns nothing if the item is refused with `base` and any companion, or without effect there.
inline std::optional<WithItem> with_item(const ModelOptions& base, const Item& item, const std::vector<Item>& all) {
  const auto made = [](ModelOptions options, std::initializer_list<const Item*> chosen) {
    for (const Item* one : chosen) one->apply(options);
    return options.tolerance ? discretised(options, *options.tolerance) : options;
  };
  const Properties wanted = properties_of(made(base, {&item}));
  for (std::size_t companion = 0; companion <= all.size(); ++companion) {
    const Item* other = companion > 0 ? &all[companion - 1] : nullptr;
    if (other != nullptr && other->name == item.name) continue;
    const ModelOptions without = other == nullptr ? base : made(base, {other});
    const ModelOptions with = other == nullptr ? made(base, {&item}) : made(base, {other, &item});
    const auto kept = [&](const Part& part) {
      return part.set == nullptr || !wanted.has(part.property) || properties_of(with).has(part.property);
    };
    const auto changed = [&](const Part& part) { return part.is_on(with) != part.is_on(without); };
    const bool has_effect = std::any_of(parts().begin(), parts().end(), changed);
    if (has_effect && std::all_of(parts().begin(), parts().end(), kept) && refusals(with).empty() &&
        refusals(without).empty())
      return WithItem{with, without, other == nullptr ? "" : other->name};
  }
  return {};
}

// Returns the options of a strategy with the chosen items. If `rubs` is true, the friction coefficient is so small that
// friction limits the shear stress. Otherwise the coefficient is so large that the yield strength of the interface or
// the flow of the layer limits the stress.
inline ModelOptions combined(Strategy strategy, std::vector<const Item*> chosen, bool rubs) {
  ModelOptions options = graded(paper_options(strategy), 6, 1.4);
  options.grid.far_boundary = rubs ? FarBoundary::kHalfSpace : FarBoundary::kInsulated;
  options.interface.friction_coefficient = rubs ? 0.02 : 2.0;
  options.initial_temperature = 600.0;
  std::sort(chosen.begin(), chosen.end());  // laws first, then options
  for (const Item* item : chosen) item->apply(options);
  if (options.friction_coefficient) options.friction_coefficient = rubs ? 0.005 : 2.0;
  if (options.tolerance) options = discretised(options, 1e-2);
  return options;
}

// Returns options with the chosen items. If the chosen items alone are refused, one or two more items that make them
// valid are added; plastic heating, for example, needs the table [hard_layer], and force-driven a plastic layer. Returns
// nothing if no such items exist.
inline std::optional<ModelOptions> possible(Strategy strategy, const std::vector<const Item*>& chosen,
                                            const std::vector<Item>& all, bool rubs) {
  ModelOptions options = combined(strategy, chosen, rubs);
  if (refusals(options).empty()) return options;
  const Properties wanted = properties_of(options);
  const auto holds = [&](const ModelOptions& with) {
    // An item may be added only if the chosen items stay in effect.
    const Properties found = properties_of(with);
    for (const Part& part : parts())
      if (part.set != nullptr && wanted.has(part.property) && !found.has(part.property)) return false;
    return refusals(with).empty();
  };
  std::vector<const Item*> more = chosen;
  for (const Item& companion : all) {
    more.push_back(&companion);
    if (options = combined(strategy, more, rubs); holds(options)) return options;
    more.pop_back();
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      more.resize(chosen.size());
      more.insert(more.end(), {&all[i], &all[j]});
      if (options = combined(strategy, more, rubs); holds(options)) return options;
    }
  }
  return {};
}

}  // namespace shearbus::testing
