#include "proto/scene/scene.hpp"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>

#include <cmath>
#include <stdexcept>

namespace shearbus::scene {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

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
                 fmt::format("{}.grading = {} with {} cells makes the first cell {:.3g} m wide, expected at least {} "
                             "m, the distance of two "
                             "atoms: take fewer cells or a ratio nearer to 1",
                             table, number_text(ratio), cells, first, kThinnestCell));
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

}  // namespace

void check_scene(const v1::Scene& scene, Findings& findings) {
  if (scene.strategy() == v1::STRATEGY_FORCE_DRIVEN && !scene.has_interface() && findings.sound("interface"))
    findings.add("strategy", "strategy force_driven needs the table [interface], which is missing");
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
}

std::vector<Fault> faults_of(v1::Scene& scene) {
  Findings findings;
  check_fields(scene, findings);
  fill_defaults(scene);
  check_scene(scene, findings);
  return findings.faults();
}

Document read(std::string_view text, std::string file, v1::Scene& scene) {
  return read(text, std::move(file), scene, [](const Message& root, Findings& findings) {
    check_scene(static_cast<const v1::Scene&>(root), findings);
  });
}

SceneFile parse(std::string text, std::string file) {
  SceneFile parsed{.scene = {}, .text = std::move(text), .document = {}};
  parsed.document = read(parsed.text, std::move(file), parsed.scene);
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
