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

What a scene can switch on, and what excludes what. `shearbus-ctl options` prints this page from the table of
[solver/parts.cpp](solver/parts.cpp) and the lists of laws, and a test compares: edit the table, then print the page.
Equations and departures are in [MODEL.md](MODEL.md), schemes in [METHODS.md](METHODS.md). `shearbus-study precision`
tells the error of each option. Costs are instructions of a node-step over those of the same step without the option,
in the paper's case on 60 graded cells, over 1 us (force-driven: under 300 m/s, so that the interface melts), counted by
[option_costs.py](../../tests/bench/option_costs.py). `shearbus-hydro --explain SCENE.toml` measures your scene on your
machine; [MEASURED.md](MEASURED.md) tells more.

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

// The name of a part of the model on the options page. A part that is an option has the name of its setting, as a scene
// writes it. A part that is a property of laws is named "a <law with this property>".
std::string name_of(const Part& part) {
  return part.law_with.empty() ? text_of('`', setting_of(part, {}), '`') : text_of("a ", part.law_with);
}

}  // namespace

std::string options_page() {
  std::string page(kHead);
  page += "## Options\n\n| key | equation | adds | cost | when |\n|---|---|---|---|---|\n";
  for (const Part& part : parts())
    if (!part.adds.empty())
      page += text_of("| ", name_of(part), " | ", part.equation, " | ", part.adds, " | ", part.cost, " | ", part.when,
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
    page +=
        "| " + name_of(part_of(e.first)) + " | " + name_of(part_of(e.second)) + " | " + std::string(e.reason) + " |\n";

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
