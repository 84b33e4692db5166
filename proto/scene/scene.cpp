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

// Rules between keys. A rule that needs a value at fault is not checked.
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

  // Options of a strength that nobody computes.
  void hard_strength() {
    const auto refuse = [&](const std::string& key) {
      add("hard." + key,
          "hard." + key + " bears on a body's strength, and only the soft body's is computed: give it to [soft]");
    };
    if (scene_.hard().melting_curve() == v1::MELTING_CURVE_LINDEMANN) refuse("melting_curve");
    if (scene_.hard().pressure_term() == v1::PRESSURE_TERM_COMPRESSED) refuse("pressure_term");
  }

  // Heat released inside the layer: by the model's own flow, and between bodies that both conduct.
  void plastic_heating() {
    const std::string path = "velocity_driven.taylor_quinney_factor";
    if (!scene_.velocity_driven().has_taylor_quinney_factor() || !sound(path)) return;
    if (scene_.strategy() == v1::STRATEGY_FORCE_DRIVEN)
      add(path,
          path +
              " heats where the velocity-driven layer flows; under strategy force_driven plastic work heats nothing");
    if (scene_.velocity_driven().drive() == v1::DRIVE_INTERFACE_SLIP)
      add(path, path +
                    " needs drive = \"layer_shear\": with \"interface_slip\" all the work of the jump is friction at "
                    "z = 0, and heat in the layer would count it twice");
    if (!scene_.has_hard_layer() && sound("hard_layer"))
      add(path, path +
                    " needs the table [hard_layer]: the fixed share of the hard body is that of heat released at "
                    "z = 0, not inside the layer");
  }

  // Beside a flowing layer the slip depends on the layer's flow, and friction on both.
  void friction() {
    const std::string path = "interface.friction_law";
    if (scene_.interface().friction_law() != v1::FRICTION_LAW_VELOCITY_WEAKENING || !scene_.interface().plastic_layer())
      return;
    add(path, path +
                  " = \"velocity_weakening\" does not go with plastic_layer: with the layer's flow beside it the slip "
                  "of a step has no friction of its own to solve for first; leave one of them out");
  }

  // Waves in the layer: where the layer carries the jump, and nothing else wants its stress to be one number.
  void inertia() {
    const std::string path = "layer.inertia";
    if (!scene_.layer().inertia()) return;
    if (scene_.strategy() == v1::STRATEGY_FORCE_DRIVEN)
      add(path, path +
                    " needs strategy velocity_driven: the masses that force_driven exchanges momentum of (DLP 61) are "
                    "those of whole zones, the layer's among them, which would then count twice");
    if (scene_.velocity_driven().drive() == v1::DRIVE_INTERFACE_SLIP)
      add(path, path +
                    " needs drive = \"layer_shear\": with \"interface_slip\" the jump is slip at z = 0 and crosses no "
                    "layer");
    if (scene_.velocity_driven().has_taylor_quinney_factor())
      add(path, path +
                    " cannot be combined with velocity_driven.taylor_quinney_factor: that shares out the work of one "
                    "stress, and with inertia the stress varies across the layer");
    if (scene_.layer().cells() > wire::kMaxInertiaCells)
      add(path, fmt::format("{} works with at most {} cells, found layer.cells = {}: grade them (layer.grading)", path,
                            wire::kMaxInertiaCells, scene_.layer().cells()));
  }

  // A second state of the node, of a model that leaves nothing out.
  void shadow() {
    const bool chosen_modes = scene_.has_tolerance() && modes_know_all();
    if (scene_.layer().shadow_share() > 0.0 && !scene_.layer().sleep() && scene_.layer().heat() != v1::HEAT_MODES &&
        !chosen_modes && sound("layer.sleep") && sound("layer.heat"))
      add("layer.shadow_share",
          "layer.shadow_share compares nodes with the same solved in full; without layer.sleep or layer.heat = "
          "\"modes\" all of them are");
  }

  // Modes of the heat, as many as vertices, and a contact that is at rest as a whole.
  void sleep() {
    const std::string path = "layer.sleep";
    if (!scene_.layer().sleep()) return;
    if (scene_.layer().inertia())
      add(path, path + " cannot be combined with layer.inertia: waves cross the layer of a contact that rests");
    if (scene_.layer().time_integrator() == v1::TIME_INTEGRATOR_SDIRK2)
      add(path, path + " needs time_integrator = \"backward_euler\": it is those steps that it takes in modes");
    if (scene_.layer().heat() == v1::HEAT_MODES)
      add(path, path + " has nothing to save with layer.heat = \"modes\", whose step without flux is as cheap");
    const v1::HardLayer& hard = scene_.hard_layer();
    const std::uint64_t cells = std::uint64_t{scene_.layer().cells()} + (!scene_.has_hard_layer() ? 0
                                                                         : hard.has_cells()       ? hard.cells()
                                                                                            : scene_.layer().cells());
    if (cells > wire::kMaxSleepCells)
      add(path, fmt::format("{} works with at most {} cells of both bodies, found {}: grade them (layer.grading)", path,
                            wire::kMaxSleepCells, cells));
  }

  void components() {
    const std::string path = "tangential_components";
    if (scene_.tangential_components() != 2) return;
    if (scene_.velocity_driven().drive() == v1::DRIVE_INTERFACE_SLIP)
      add(path, path +
                    " = 2 needs drive = \"layer_shear\": the shear rate that drives the layer with \"interface_slip\" "
                    "has no direction");
    if (scene_.layer().inertia())
      add(path, path +
                    " = 2 cannot be combined with layer.inertia: the stress of a step has one direction, and that of "
                    "waves turns across the layer");
  }

  // What stands in the way of second order is what a step takes from the one before or from its own length.
  void time_integrator() {
    const std::string path = "layer.time_integrator";
    if (scene_.layer().time_integrator() != v1::TIME_INTEGRATOR_SDIRK2) return;
    const auto refuse = [&](std::string_view why) { add(path, path + " = \"sdirk2\" " + std::string(why)); };
    if (scene_.velocity_driven().has_taylor_quinney_factor())
      refuse(
          "has no use with velocity_driven.taylor_quinney_factor: where the work becomes heat is taken from the step "
          "before, which is first order");
    if (scene_.interface().plastic_layer())
      refuse("is not made for interface.plastic_layer, whose slip and flow share one balance per step");
    if (scene_.layer().inertia())
      refuse(
          "is of the heat only, and with layer.inertia the waves are followed to first order: leave out one of them");
    if (scene_.has_junctions())
      refuse("is not made for [junctions], whose strain grows with the slip of the whole step");
    if (scene_.interface().friction_law() == v1::FRICTION_LAW_VELOCITY_WEAKENING)
      refuse(
          "is not made for friction_law = \"velocity_weakening\", whose friction is found for the mean slip of a step");
  }

  // The interface temperature of one body, of which heat without a profile knows nothing inside.
  bool modes_know_all() const {
    return scene_.strategy() == v1::STRATEGY_FORCE_DRIVEN && !scene_.interface().plastic_layer() &&
           !scene_.has_hard_layer();
  }

  void modes() {
    const bool plastic_layer = scene_.interface().plastic_layer();
    if (scene_.layer().heat() == v1::HEAT_MODES) {
      if (plastic_layer)
        add("layer.heat",
            "layer.heat = \"modes\" keeps no temperature inside the layer, and interface.plastic_layer flows by it");
      if (scene_.strategy() == v1::STRATEGY_VELOCITY_DRIVEN)
        add("layer.heat",
            "layer.heat = \"modes\" keeps no temperature inside the layer, and strategy velocity_driven flows by it");
      if (scene_.has_hard_layer())
        add("layer.heat", "layer.heat = \"modes\" follows one body: leave out [hard_layer], or keep the profile");
    }
    if (scene_.layer().heat() != v1::HEAT_MODES || !sound("layer.modes.shortest_step_s") ||
        !sound("layer.modes.longest_time_s"))
      return;
    const v1::HeatModes& modes = scene_.layer().modes();
    if (modes.longest_time_s() < modes.shortest_step_s())
      add("layer.modes.longest_time_s",
          fmt::format("layer.modes.longest_time_s = {} s is below layer.modes.shortest_step_s = {} s",
                      number_text(modes.longest_time_s()), number_text(modes.shortest_step_s())));
  }

  // A tolerance is kept only where the error of T0 falls as grid and step get finer.
  void tolerance() {
    if (!scene_.has_tolerance()) return;
    if (scene_.velocity_driven().has_taylor_quinney_factor())
      add("tolerance",
          "tolerance does not go with velocity_driven.taylor_quinney_factor: where the flow gathers in a band depends "
          "on cells and steps, and no estimate can tell");
    if (scene_.layer().inertia())
      add("tolerance",
          "tolerance does not go with layer.inertia: the error is told by the interface temperature, and waves cross "
          "the layer unseen there");
  }

  void strategy() {
    if (scene_.strategy() == v1::STRATEGY_FORCE_DRIVEN && !scene_.has_interface() && sound("interface"))
      add("strategy", "strategy force_driven needs the table [interface], which is missing");
    if (scene_.strategy() == v1::STRATEGY_VELOCITY_DRIVEN && scene_.interface().plastic_layer())
      add("interface.plastic_layer",
          "interface.plastic_layer is an option of strategy force_driven; a velocity-driven layer always flows");
  }

  void junctions() {
    if (!scene_.has_junctions()) return;
    if (scene_.strategy() == v1::STRATEGY_VELOCITY_DRIVEN)
      add("junctions",
          "[junctions] is an option of strategy force_driven: the velocity-driven layer's stress is that of its flow");
    if (scene_.interface().plastic_layer())
      add("junctions",
          "[junctions] and interface.plastic_layer exclude each other: junctions harden with all the slip there is, "
          "and "
          "a layer that flows beside them takes part of it; leave one of them out");
    if (scene_.interface().friction_law() == v1::FRICTION_LAW_VELOCITY_WEAKENING)
      add("junctions",
          "[junctions] and interface.friction_law = \"velocity_weakening\" exclude each other: with slip one limit "
          "rises and the other falls, and an answer would not be found for sure; leave one of them out");
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
  checks.plastic_heating();
  checks.inertia();
  checks.sleep();
  checks.shadow();
  checks.components();
  checks.time_integrator();
  checks.tolerance();
  checks.modes();
  checks.hard_strength();
  checks.junctions();
  checks.friction();
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
