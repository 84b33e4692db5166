#include "server/physics/solver/options_page.hpp"

#include <string_view>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/parts.hpp"
#include "server/physics/solver/text.hpp"

namespace shearbus::physics {
namespace {

constexpr std::string_view kHead =
    R"(# Options of the physics

What a scene can switch on, and what excludes what, as `shearbus-ctl options` prints it. Equations and departures are in
server/physics/MODEL.md, schemes in server/physics/METHODS.md. `shearbus-study precision` tells the error of each
option. Costs are instructions of a node-step over those of the same step without the option, in the paper's case on 60
graded cells, over 1 us (force-driven: under 300 m/s, so that the interface melts), which a test counts again
(tests/bench/option_costs.py). `shearbus-hydro --explain SCENE.toml` measures your scene on your machine.

)";

std::string row(std::string_view key, std::string_view equation, std::string_view adds, std::string_view when) {
  return text_of("| ", key, " | ", equation, " | ", adds, " | ", when, " |\n");
}

template <class Law>
std::string row_of_law() {
  return row(text_of("`\"", Law::kName, "\"`"), Law::kEquation, Law::kAdds, Law::kWhen);
}

template <class Laws>
std::string table_of_laws() {
  std::string text;
  for (int n = 1; const auto law = Laws::numbered(n); ++n)
    text += Laws::with(*law, [](auto own) { return row_of_law<typename decltype(own)::type>(); });
  return text;
}

// The name of a part on the options page: a setting is code.
std::string shown(const Part& part) {
  const std::string name = name_of(part, {});
  return name == setting_of(part, {}) ? '`' + name + '`' : name;
}

template <class Members>
std::string listed(const Members& members, std::string_view between) {
  std::string all;
  for (const Part& part : parts())
    if (members.has(part.property)) all += text_of(all.empty() ? "" : between, shown(part));
  return all;
}

}  // namespace

std::string options_page() {
  std::string page(kHead);
  page += "## Options\n\n| key | equation | adds | cost | when |\n|---|---|---|---|---|\n";
  for (const Part& part : parts())
    if (!part.adds.empty())
      page += text_of("| ", shown(part), " | ", part.equation, " | ", part.adds, " | ", part.cost, " | ", part.when,
                      " |\n");

  page += "\n## Friction laws: `interface.friction_law`\n\n" + row("law", "equation", "adds", "when") +
          "|---|---|---|---|\n" + table_of_laws<FrictionLaws>();
  page += "\n## Flow laws: `soft.flow_law`\n\n" + row("law", "equation", "adds", "when") + "|---|---|---|---|\n" +
          table_of_laws<FlowLaws>();

  page +=
      "\n## What excludes what\n\n"
      "A scene that names both is refused, with this reason and the place of the first key. Laws are excluded by what\n"
      "they declare, not by name: a law that is added is allowed where its properties are. A pair that no row of the\n"
      "table decides about is refused as well.\n\n"
      "| | does not go with | because |\n|---|---|---|\n";
  for (const Exclusion& e : exclusions())
    page += text_of("| ", listed(e.first, ", "), " | ", listed(e.second, ", "), " | ", e.reason, " |\n");

  page +=
      "\n## What is an option of what\n\n"
      "These are no exclusions but the structure of a scene. A part is refused without what it is an option of.\n\n"
      "| | is an option of |\n|---|---|\n";
  for (const Part& part : parts()) {
    Properties needed;
    for (const Part& other : parts())  // a plastic layer is itself the layer that flows
      if (part.needs.has(other.property) &&
          (other.property != Property::kFlowingLayer || part.property != Property::kPlasticLayer))
        needed.add(other.property);
    if (part.set != nullptr && !needed.empty())
      page += text_of("| ", shown(part), " | ", listed(needed, " and "), " |\n");
  }
  page += "\nA model has one of each line, or at most one:\n\n";
  for (const Properties& choice : choices()) page += text_of("- ", listed(choice, ", "), "\n");

  page += "\n## Laws and their properties\n\n| law | properties that exclude options |\n|---|---|\n";
  const auto properties = [&](std::string_view law, const ModelOptions& options, std::string_view key) {
    std::string all;
    for (const Part& part : parts())
      if (part.key == key && part.is_on(options)) all += text_of(all.empty() ? "" : "; ", part.law_with);
    page += text_of("| `", law, "` | ", all.empty() ? "none" : all, " |\n");
  };
  for (int n = 1; const auto law = FrictionLaws::numbered(n); ++n) {
    ModelOptions options;
    options.strategy = Strategy::kForceDriven;  // a friction law acts
    options.interface.friction_law = *law;
    properties(FrictionLaws::name_of(*law), options, "interface.friction_law");
  }
  for (int n = 1; const auto law = FlowLaws::numbered(n); ++n) {
    ModelOptions options;
    options.soft.flow_law = *law;
    properties(FlowLaws::name_of(*law), options, "soft.flow_law");
  }
  return page;
}

}  // namespace shearbus::physics
