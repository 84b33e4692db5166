#include "proto/scene/scene.hpp"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <stdexcept>

namespace shearbus::scene {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

namespace {

// Smallest accepted width of the first cell, the distance of neighbouring atoms in iron (0.248 nm; aluminium 0.286 nm):
// below it a metal has neither a temperature nor a flow stress. A thinner cell is a mistake in the keys cells or grading.
constexpr double kThinnestCell = 0.25e-9;  // [m]
constexpr double kRounding = 1e-9;         // relative error of the width as computed here
// Number of cells that the check assumes if the scene requests a tolerance, which lets the server choose the cells.
constexpr std::uint32_t kCellsOfTolerance = 1;

bool sound_grid(const Findings& findings, const std::string& table) {
  return findings.sound(table) && findings.sound(table + ".thickness_m") && findings.sound(table + ".cells") &&
         findings.sound(table + ".grading");
}

void check_first_cell(const std::string& table, double thickness, std::uint32_t cells, double ratio, bool grading_given,
                      Findings& findings) {
  const double sum = ratio == 1.0 ? cells : std::expm1(cells * std::log(ratio)) / (ratio - 1.0);
  const double first = thickness / sum;
  if (!(first >= kThinnestCell * (1.0 - kRounding)))
    findings.add(table + (grading_given ? ".grading" : ".cells"),
                 fmt::format("{0}.thickness_m = {1} m, {0}.cells = {2} and {0}.grading = {3} make the first cell "
                             "{4:.3g} m wide, expected at least {5} m, the distance of two atoms: take fewer cells or "
                             "a ratio nearer to 1",
                             table, number_text(thickness), cells, number_text(ratio), first, kThinnestCell));
}

void check_grids(const v1::Scene& scene, Findings& findings) {
  const v1::Layer& layer = scene.layer();
  if (!sound_grid(findings, "layer")) return;
  const std::uint32_t cells = layer.has_cells() ? layer.cells() : kCellsOfTolerance;
  const double grading = layer.has_grading() ? layer.grading() : 1.0;
  check_first_cell("layer", layer.thickness_m(), cells, grading, grading != 1.0, findings);
  if (!scene.has_hard_layer() || !sound_grid(findings, "hard_layer")) return;
  // A key that [hard_layer] lacks is checked with the value in [layer]. If the thickness is the absent key, the server
  // later computes one, which differs from that in [layer] only by a small factor.
  const v1::HardLayer& hard = scene.hard_layer();
  check_first_cell("hard_layer", hard.has_thickness_m() ? hard.thickness_m() : layer.thickness_m(),
                   hard.has_cells() ? hard.cells() : cells, hard.has_grading() ? hard.grading() : grading,
                   hard.has_grading(), findings);
}

// Calls use(field of the pair, field of the scene) for each table that a pair may have.
template <typename Use>
void for_tables_of_pair(const Use& use) {
  const google::protobuf::Descriptor& scene = *v1::Scene::descriptor();
  for (const FieldDescriptor* field : keys_of(*v1::Pair::descriptor()))
    use(*field, *scene.FindFieldByName(field->name()));
}

bool begins_with_table_of(const v1::Pair& pair, std::string_view path) {
  const FieldDescriptor* field = v1::Pair::descriptor()->FindFieldByName(std::string(path.substr(0, path.find('.'))));
  return field && field->message_type() && pair.GetReflection()->HasField(pair, field);
}

// Checks a pair as the scene that it makes with the tables outside, and adds the faults that the scene without it does
// not have.
void check_pair(const v1::Scene& outside, const v1::Pair& pair, Findings& findings) {
  const std::string table = "pair." + pair.name();
  Findings of_pair([&](std::string_view path) {
    return findings.sound(table + "." + std::string(path)) &&
           (begins_with_table_of(pair, path) || findings.sound(path));
  });
  v1::Scene whole = scene_of_pair(outside, pair);
  check_fields(whole, of_pair);
  fill_defaults(whole);
  check_scene(whole, of_pair);
  for (const Fault& fault : of_pair.faults()) {
    const bool elsewhere = !begins_with_table_of(pair, fault.path);
    if (elsewhere && !findings.sound(fault.path)) continue;
    findings.add(elsewhere ? table : table + "." + fault.path, fmt::format("[{}]: {}", table, fault.text));
  }
}

}  // namespace

v1::Scene without_pairs(const v1::Scene& scene) {
  v1::Scene outside = scene;
  outside.clear_pair();
  return outside;
}

v1::Scene scene_of_pair(const v1::Scene& scene, const v1::Pair& pair) {
  v1::Scene whole = scene;
  for_tables_of_pair([&](const FieldDescriptor& from, const FieldDescriptor& to) {
    if (pair.GetReflection()->HasField(pair, &from))
      whole.GetReflection()->MutableMessage(&whole, &to)->CopyFrom(pair.GetReflection()->GetMessage(pair, &from));
  });
  return whole;
}

void set_pair(const v1::Scene& scene, const v1::Scene& whole, v1::Pair& pair) {
  for_tables_of_pair([&](const FieldDescriptor& to, const FieldDescriptor& from) {
    pair.GetReflection()->ClearField(&pair, &to);
    if (!whole.GetReflection()->HasField(whole, &from)) return;
    const Message& table = whole.GetReflection()->GetMessage(whole, &from);
    if (table.SerializeAsString() != scene.GetReflection()->GetMessage(scene, &from).SerializeAsString())
      pair.GetReflection()->MutableMessage(&pair, &to)->CopyFrom(table);
  });
}

namespace {

std::string difference_of(const Message& a, const Message& b, const std::string& path, MayDiffer may_differ) {
  for (const FieldDescriptor* field : keys_of(*a.GetDescriptor())) {
    if (field->is_repeated()) continue;
    std::string key = path_of(path, *field);
    const bool given = a.GetReflection()->HasField(a, field);
    if (given != b.GetReflection()->HasField(b, field)) {
      if (!may_differ(key, field->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE)) return key;
    } else if (given && field->message_type()) {
      std::string inner = difference_of(a.GetReflection()->GetMessage(a, field),
                                        b.GetReflection()->GetMessage(b, field), key, may_differ);
      if (!inner.empty()) return inner;
    } else if (given && !may_differ(key, field->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE) &&
               value_text(a, *field) != value_text(b, *field)) {
      return key;
    }
  }
  return {};
}

}  // namespace

std::string first_difference(const v1::Scene& a, const v1::Scene& b, MayDiffer may_differ) {
  return difference_of(a, b, "", may_differ);
}

namespace {

// The field of the scene that holds the table of "table.key".
const FieldDescriptor* table_of(std::string_view path) {
  const FieldDescriptor* table = v1::Scene::descriptor()->FindFieldByName(std::string(path.substr(0, path.find('.'))));
  return table && table->message_type() && !table->is_repeated() && path.find('.') != path.npos ? table : nullptr;
}

}  // namespace

const FieldDescriptor* find_number(std::string_view path) {
  const FieldDescriptor* table = table_of(path);
  if (!table) return nullptr;
  const FieldDescriptor* key = table->message_type()->FindFieldByName(std::string(path.substr(path.find('.') + 1)));
  return key && key->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE && !key->is_repeated() ? key : nullptr;
}

std::optional<double> value_of(const v1::Scene& scene, std::string_view path) {
  const FieldDescriptor* key = find_number(path);
  if (!key || !scene.GetReflection()->HasField(scene, table_of(path))) return std::nullopt;
  const Message& table = scene.GetReflection()->GetMessage(scene, table_of(path));
  if (!table.GetReflection()->HasField(table, key)) return std::nullopt;
  return table.GetReflection()->GetDouble(table, key);
}

void set_value(v1::Scene& scene, std::string_view path, double value) {
  Message& table = *scene.GetReflection()->MutableMessage(&scene, table_of(path));
  table.GetReflection()->SetDouble(&table, find_number(path), value);
}

namespace {

// A force-driven interface yields, and so do junctions; a velocity-driven interface without them yields as its layer.
void check_yield_strength(const v1::Scene& scene, Findings& findings) {
  if (!findings.sound("strategy") || !findings.sound("interface.yield_strength_pa")) return;
  const bool forced = scene.strategy() == v1::STRATEGY_FORCE_DRIVEN;
  const bool given = scene.interface().has_yield_strength_pa();
  if (scene.has_junctions() && !scene.has_interface() && !forced && findings.sound("interface"))
    findings.add("junctions", "[junctions] need the table [interface] with their yield_strength_pa, which is missing");
  else if (scene.has_interface() && !given && (forced || scene.has_junctions()))
    findings.add("interface",
                 "interface.yield_strength_pa is missing (Tresca: s <= this * g(P, T0) / sqrt(3)): force_driven and "
                 "[junctions] need it");
  else if (given && !forced && !scene.has_junctions())
    findings.add("interface.yield_strength_pa",
                 "interface.yield_strength_pa is for force_driven or [junctions]: a velocity_driven interface without "
                 "junctions yields as its layer does");
}

// A table of k(T) or c(T): two lists of one length, the first of rising temperatures.
template <typename List>
void check_table(const std::string& body, const std::string& quantity, const std::string& unit, bool has_slope,
                 const List& temperatures, const List& values, Findings& findings) {
  constexpr int kMostRows = 100;
  const std::string T = fmt::format("{}.{}_table_temperature_k", body, quantity);
  const std::string of_T = fmt::format("{}.{}_table_{}", body, quantity, unit);
  if (!findings.sound(T) || !findings.sound(of_T) || (temperatures.empty() && values.empty())) return;
  const int rows = temperatures.size();
  if (rows == 0 || values.empty())
    return findings.add(rows == 0 ? of_T : T, fmt::format("{} is one column of a table: give {}, too",
                                                          rows == 0 ? of_T : T, rows == 0 ? T : of_T));
  if (values.size() != rows)
    return findings.add(
        of_T, fmt::format("{} has {} values for {} temperatures: expected as many", of_T, values.size(), rows));
  if (rows < 2 || rows > kMostRows)
    return findings.add(T, fmt::format("{} has {} values, expected 2 to {}", T, rows, kMostRows));
  for (int i = 1; i < rows; ++i)
    if (!(temperatures[i] > temperatures[i - 1]))
      return findings.add(T, fmt::format("{}[{}] = {} K is not above the temperature before it, {} K: sort the rows", T,
                                         i, number_text(temperatures[i]), number_text(temperatures[i - 1])));
  const std::string slope = fmt::format("{}.{}_slope_per_k", body, quantity);
  if (has_slope)
    findings.add(slope,
                 fmt::format("{} and {} both say how it follows the temperature: leave out one of them", slope, of_T));
}

void check_heat_tables(const v1::Body& body, const std::string& name, Findings& findings) {
  check_table(name, "thermal_conductivity", "w_per_m_k", body.has_thermal_conductivity_slope_per_k(),
              body.thermal_conductivity_table_temperature_k(), body.thermal_conductivity_table_w_per_m_k(), findings);
  check_table(name, "specific_heat", "j_per_kg_k", body.has_specific_heat_slope_per_k(),
              body.specific_heat_table_temperature_k(), body.specific_heat_table_j_per_kg_k(), findings);
}

}  // namespace

void check_scene(const v1::Scene& scene, Findings& findings) {
  if (scene.strategy() == v1::STRATEGY_FORCE_DRIVEN && !scene.has_interface() && findings.sound("interface"))
    findings.add("strategy", "strategy force_driven needs the table [interface], which is missing");
  check_yield_strength(scene, findings);
  check_heat_tables(scene.soft(), "soft", findings);
  check_heat_tables(scene.hard(), "hard", findings);
  check_grids(scene, findings);
  const auto soft_only = [&](bool given, const std::string& key) {
    if (given)
      findings.add("hard." + key, "hard." + key +
                                      " bears on a body's strength, and only the soft body's is computed: give it to "
                                      "[soft]");
  };
  soft_only(scene.hard().melting_curve() == v1::MELTING_CURVE_LINDEMANN ||
                scene.hard().melting_curve() == v1::MELTING_CURVE_SIMON,
            "melting_curve");
  soft_only(scene.hard().pressure_term() == v1::PRESSURE_TERM_COMPRESSED, "pressure_term");
  if (scene.pair().empty()) return;
  const v1::Scene outside = without_pairs(scene);
  for (const v1::Pair& pair : scene.pair()) check_pair(outside, pair, findings);
}

std::vector<Fault> faults_of(v1::Scene& scene) {
  Findings findings;
  check_fields(scene, findings);
  fill_defaults(scene);
  check_scene(scene, findings);
  return findings.faults();
}

Document read(std::string_view text, const std::string& file, v1::Scene& scene, MoreRules more) {
  return read(text, file, scene, [more](const Message& root, Findings& findings) {
    check_scene(static_cast<const v1::Scene&>(root), findings);
    if (more != nullptr) more(static_cast<const v1::Scene&>(root), findings);
  });
}

SceneFile parse(std::string text, const std::string& file) {
  SceneFile parsed{.text = std::move(text)};
  parsed.document = read(parsed.text, file, parsed.scene);
  return parsed;
}

SceneFile load(const std::filesystem::path& path) {
  return parse(read_file(path), path.string());
}

std::vector<std::pair<std::string, double>> numbers_of(const Message& table) {
  std::vector<std::pair<std::string, double>> numbers;
  for (int i = 0; i < table.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor* field = table.GetDescriptor()->field(i);
    if (field->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE && !field->is_repeated() &&
        table.GetReflection()->HasField(table, field))
      numbers.emplace_back(field->name(), table.GetReflection()->GetDouble(table, field));
  }
  return numbers;
}

void set_numbers(const std::vector<std::pair<std::string, double>>& numbers, Message& table) {
  for (const auto& [name, value] : numbers) {
    const FieldDescriptor* field = table.GetDescriptor()->FindFieldByName(name);
    if (!field || field->cpp_type() != FieldDescriptor::CPPTYPE_DOUBLE || field->is_repeated())
      throw std::invalid_argument(name + " is not a number of " + table.GetDescriptor()->name());
    table.GetReflection()->SetDouble(&table, field, value);
  }
}

}  // namespace shearbus::scene
