// Combinations of model options for tests: every option of the table of solver/parts.cpp and every law of the lists, so
// that a new row or law is tested without an edit here.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
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
    // These constants give the compression at a pressure; not every metal of the catalog has them.
    if (!std::isfinite(soft.sound_speed)) soft.sound_speed = aluminium.sound_speed;
    if (!std::isfinite(soft.hugoniot_slope)) soft.hugoniot_slope = aluminium.hugoniot_slope;
    if (!std::isfinite(soft.grueneisen)) soft.grueneisen = aluminium.grueneisen;
    if (!std::isfinite(soft.volume_correction)) soft.volume_correction = aluminium.volume_correction;
    return;
  }
  throw Broken(fmt::format("no material of the catalog follows {}", FlowLaws::name_of(law)));
}

// Returns a material with the strength and flow law of one metal and the heat and melting constants of the other.
inline Material with_strength_of(const Material& heat, Material strength) {
  strength.conductivity = heat.conductivity;
  strength.specific_heat = heat.specific_heat;
  strength.diffusivity = heat.diffusivity;
  strength.density = heat.density;
  strength.melting_temperature = heat.melting_temperature;
  strength.melting_curve = heat.melting_curve;
  return strength;
}

// Laws come first, because typical values of an option may depend on the material.
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
                   },
                   Kind::kFrictionLaw});
  for (const Part& part : parts()) {
    if (part.set == nullptr) continue;
    all.push_back({std::string(part.key), [&part](ModelOptions& o) { part.set(o, true); }});
  }
  return all;
}

// Returns the options of a strategy with some items. With `rubs` friction limits the stress in the histories below,
// otherwise the yield limit or the layer does.
inline ModelOptions combined(Strategy strategy, std::vector<const Item*> chosen, bool rubs) {
  ModelOptions options = graded(paper_options(strategy), 6, 1.4);
  options.grid.far_boundary = rubs ? FarBoundary::kHalfSpace : FarBoundary::kInsulated;
  options.interface.friction_coefficient = rubs ? 0.02 : 2.0;
  options.initial_temperature = 600.0;
  std::sort(chosen.begin(), chosen.end());  // in the order of the list: laws first
  for (const Item* item : chosen) item->apply(options);
  if (options.friction_coefficient) options.friction_coefficient = rubs ? 0.005 : 2.0;
  if (options.tolerance) options = discretised(options, 1e-2);
  return options;
}

// Returns the options with the chosen items, if needed with one more item that they depend on; plastic heating, for
// example, needs the table [hard_layer].
inline std::optional<ModelOptions> possible(Strategy strategy, const std::vector<const Item*>& chosen,
                                            const std::vector<Item>& all, bool rubs) {
  ModelOptions options = combined(strategy, chosen, rubs);
  if (refusals(options).empty()) return options;
  for (const Item& companion : all) {
    std::vector<const Item*> more = chosen;
    more.push_back(&companion);
    options = combined(strategy, more, rubs);
    // The companion must add to the chosen items, not replace one.
    Properties wanted = properties_of(combined(strategy, chosen, rubs));
    const Properties found = properties_of(options);
    bool kept = true;
    for (const Part& part : parts())
      if (part.set != nullptr && wanted.has(part.property)) kept = kept && found.has(part.property);
    if (kept && refusals(options).empty()) return options;
  }
  return {};
}

}  // namespace shearbus::testing
