#include "proto/scene/scene.hpp"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "proto/wire/limits.hpp"

namespace shearbus::scene {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

// Atoms are a hundred times larger: a thinner cell is a mistake in cells or grading.
constexpr double kThinnestCell = 1e-12;           // [m]
constexpr std::uint32_t kCellsOfTolerance = 500;  // of a layer whose grid the server chooses, for the thickness's sake

// Rules between keys that the schema cannot express; which options of the physics exclude each other is known to the physics alone
// (server/physics/solver/parts.hpp). A rule that needs a value at fault is not checked.
class CrossChecks {
 public:
  CrossChecks(const v1::Scene& scene, Findings& findings) : scene_(scene), findings_(findings) {}

  void layers() {
    const v1::Layer& layer = scene_.layer();
    if (!sound_grid("layer")) return;
    const std::uint32_t cells = layer.has_cells() ? layer.cells() : kCellsOfTolerance;
    const double grading = layer.has_grading() ? layer.grading() : 1.0;
    first_cell("layer", layer.thickness_m(), cells, grading);
    if (!scene_.has_hard_layer() || !sound_grid("hard_layer")) return;
    // An absent key is as in [layer]; the thickness that the server derives is within a few times of it.
    const v1::HardLayer& hard = scene_.hard_layer();
    first_cell("hard_layer", hard.has_thickness_m() ? hard.thickness_m() : layer.thickness_m(),
               hard.has_cells() ? hard.cells() : cells, hard.has_grading() ? hard.grading() : grading);
  }

  // The strength of the soft body alone is computed.
  void hard_strength() {
    const auto refuse = [&](const std::string& key) {
      add("hard." + key,
          "hard." + key + " bears on a body's strength, and only the soft body's is computed: give it to [soft]");
    };
    if (scene_.hard().melting_curve() == v1::MELTING_CURVE_LINDEMANN) refuse("melting_curve");
    if (scene_.hard().pressure_term() == v1::PRESSURE_TERM_COMPRESSED) refuse("pressure_term");
  }

  void strategy() {
    if (scene_.strategy() == v1::STRATEGY_FORCE_DRIVEN && !scene_.has_interface() && sound("interface"))
      add("strategy", "strategy force_driven needs the table [interface], which is missing");
  }

 private:
  void add(std::string path, std::string text) { findings_.add(std::move(path), std::move(text)); }
  bool sound(std::string_view path) const { return findings_.sound(path); }
  bool sound_grid(const std::string& name) const {
    return sound(name) && sound(name + ".thickness_m") && sound(name + ".cells") && sound(name + ".grading");
  }

  void first_cell(const std::string& name, double thickness, std::uint32_t cells, double ratio) {
    const double sum = ratio == 1.0 ? cells : std::expm1(cells * std::log(ratio)) / (ratio - 1.0);
    const double first = thickness / sum;
    if (!(first >= kThinnestCell))
      add(name + (ratio == 1.0 ? ".cells" : ".grading"),
          fmt::format("{}.grading = {} with {} cells makes the first cell {:.3g} m wide, expected at least {} m: take "
                      "fewer cells or a ratio nearer to 1",
                      name, number_text(ratio), cells, first, kThinnestCell));
  }

  const v1::Scene& scene_;
  Findings& findings_;
};

}  // namespace

void check_scene(const v1::Scene& scene, Findings& findings) {
  CrossChecks checks(scene, findings);
  checks.strategy();
  checks.layers();
  checks.hard_strength();
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
