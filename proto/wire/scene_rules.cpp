#include "proto/wire/scene_rules.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "proto/wire/limits.hpp"
#include "proto/wire/scene_message.hpp"
#include "proto/wire/with_message.hpp"
#include "shearbus/v1/scene.pb.h"

namespace shearbus::wire {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

// A cell thinner than this is a slip in cells or grading: atoms are a hundred times larger.
constexpr double kThinnestCell = 1e-12;  // [m]

const v1::Rule& rule_of(const FieldDescriptor& field) {
  return field.options().GetExtension(v1::rule);
}

std::string unit_of(const FieldDescriptor& field) {
  const std::string& unit = rule_of(field).unit();
  return unit.empty() || unit == "1" ? std::string() : " " + unit;
}

class Checker {
 public:
  Checker(const std::function<bool(std::string_view)>& given, std::vector<Fault>& faults)
      : given_(given), faults_(faults) {}

  void table(const Message& message, const std::string& path) {
    for (int i = 0; i < message.GetDescriptor()->field_count(); ++i) {
      const FieldDescriptor& field = *message.GetDescriptor()->field(i);
      const std::string name = path.empty() ? field.name() : path + "." + field.name();
      if (unused(message, field, name)) continue;
      if (field.is_repeated())
        list(message, field, path, name);
      else if (!message.GetReflection()->HasField(message, &field))
        absent(message, field, path, name);
      else if (field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE)
        table(message.GetReflection()->GetMessage(message, &field), name);
      else
        value(message, field, name);
    }
  }

 private:
  void add(std::string path, std::string text) { faults_.push_back({std::move(path), std::move(text)}); }

  // A field that another's choice makes meaningless: refused where it is given, not missed where it is not.
  bool unused(const Message& message, const FieldDescriptor& field, const std::string& name) {
    const std::string& condition = rule_of(field).used_with();
    if (condition.empty()) return false;
    const std::size_t equals = condition.find('=');
    const FieldDescriptor& other = *message.GetDescriptor()->FindFieldByName(condition.substr(0, equals));
    const std::vector<std::string> choices = choices_of(other);
    const int chosen = message.GetReflection()->GetEnumValue(message, &other);
    // Where nothing is chosen and no default said, what is named elsewhere (a catalog) may choose: only absence is
    // judged, as if by the first choice.
    const bool open = chosen == 0 && rule_of(other).default_text().empty();
    const auto* value = other.enum_type()->FindValueByNumber(chosen);
    if (!value) return false;  // at fault itself
    const std::string& choice = chosen != 0 ? choices[static_cast<std::size_t>(value->index()) - 1]
                                : open      ? choices.front()
                                            : rule_of(other).default_text();
    if (choice == condition.substr(equals + 1)) return false;
    const bool present = message.GetReflection()->HasField(message, &field);
    if (present && open) return false;
    if (present)
      add(name, fmt::format("{} is used only with {} = \"{}\", found \"{}\"", name, other.name(),
                            condition.substr(equals + 1), choice));
    return true;
  }

  void absent(const Message& message, const FieldDescriptor& field, const std::string& table_path,
              const std::string& name) {
    if (given_(name)) return;
    const v1::Rule& rule = rule_of(field);
    const std::string meaning = rule.meaning().empty() ? std::string() : fmt::format(" ({})", rule.meaning());
    if (rule.required()) {
      const bool is_table = field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE;
      add(table_path, fmt::format("{} is missing{}", is_table ? "[" + name + "]" : name, meaning));
    } else if (!rule.required_without().empty()) {
      const FieldDescriptor* other = message.GetDescriptor()->FindFieldByName(rule.required_without());
      const std::string other_name = table_path.empty() ? other->name() : table_path + "." + other->name();
      if (message.GetReflection()->HasField(message, other) || given_(other_name)) return;
      const bool of_the_scene = table_path.empty();  // where a reader knows that a scene has bodies and a strategy
      const bool is_table = field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE;
      add(table_path, fmt::format("{} is missing{}{}", is_table ? "[" + name + "]" : name, meaning,
                                  of_the_scene ? "" : fmt::format(": it must be given where {} is not", other_name)));
    }
  }

  void value(const Message& message, const FieldDescriptor& field, const std::string& name) {
    const auto& reflection = *message.GetReflection();
    switch (field.cpp_type()) {
      case FieldDescriptor::CPPTYPE_DOUBLE:
        number(field, name, name, reflection.GetDouble(message, &field));
        break;
      case FieldDescriptor::CPPTYPE_UINT32:
        number(field, name, name, reflection.GetUInt32(message, &field));
        break;
      case FieldDescriptor::CPPTYPE_ENUM: {
        const int chosen = reflection.GetEnumValue(message, &field);
        if (!field.enum_type()->FindValueByNumber(chosen))
          add(name, fmt::format("{} = {} is not one of \"{}\"", name, chosen, fmt::join(choices_of(field), "\", \"")));
        break;
      }
      case FieldDescriptor::CPPTYPE_STRING: {
        const std::size_t size = reflection.GetString(message, &field).size();
        if (size > kMaxTextBytes)
          add(name, fmt::format("{} has {} bytes, expected at most {}", name, size, kMaxTextBytes));
        break;
      }
      default:
        break;
    }
  }

  void list(const Message& message, const FieldDescriptor& field, const std::string& table_path,
            const std::string& name) {
    const auto& reflection = *message.GetReflection();
    const int size = reflection.FieldSize(message, &field);
    if (size == 0) return absent(message, field, table_path, name);
    if (static_cast<std::size_t>(size) > kMaxNodesPerSession)
      return add(name, fmt::format("{} has {} values, expected at most {}", name, size, kMaxNodesPerSession));
    for (int i = 0; i < size; ++i)
      if (!number(field, name, size == 1 ? name : fmt::format("{}[{}]", name, i),
                  reflection.GetRepeatedDouble(message, &field, i)))
        return;  // the first bad value of a list tells enough
  }

  bool number(const FieldDescriptor& field, const std::string& path, const std::string& name, double value) {
    const v1::Rule& rule = rule_of(field);
    if (!std::isfinite(value)) {
      add(path, fmt::format("{} = {} is not a finite number", name, value));
      return false;
    }
    const bool inside = !(rule.has_at_least() && value < rule.at_least()) &&
                        !(rule.has_at_most() && value > rule.at_most()) &&
                        !(rule.has_above() && value <= rule.above()) && !(rule.has_below() && value >= rule.below());
    if (!inside)
      add(path, fmt::format("{} = {}{} is out of range, expected {}", name, number_text(value), unit_of(field),
                            bounds_of(field)));
    return inside;
  }

  const std::function<bool(std::string_view)>& given_;
  std::vector<Fault>& faults_;
};

// ---- rules that look at more than one field ----

// Holds its tongue where a value it needs is already at fault, or was given and could not be read.
class Together {
 public:
  Together(const v1::Scene& scene, const std::function<bool(std::string_view)>& given, std::vector<Fault>& faults)
      : scene_(scene), given_(given), faults_(faults) {}

  void layers() {
    if (!sound_grid("layer", scene_.has_layer(), scene_.layer())) return;
    with_message<v1::Scene>([&](v1::Scene& filled) {
      filled = scene_;
      fill_defaults(filled);
      first_cells(filled.layer());
    });
  }

  void first_cells(const v1::Layer& layer) {
    first_cell("layer", scene_.layer().has_grading(), layer.thickness_m(), layer.cells(), layer.grading());
    if (!scene_.has_hard_layer() || !sound_grid("hard_layer", true, scene_.hard_layer())) return;
    // Absent is as [layer]; the thickness a server derives is within a few times of it.
    const v1::HardLayer& hard = scene_.hard_layer();
    first_cell("hard_layer", hard.has_grading(), hard.has_thickness_m() ? hard.thickness_m() : layer.thickness_m(),
               hard.has_cells() ? hard.cells() : layer.cells(), hard.has_grading() ? hard.grading() : layer.grading());
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
    if (!scene_.velocity_driven().has_taylor_quinney_factor() || !sound(path, true)) return;
    if (scene_.strategy() == v1::STRATEGY_FORCE_DRIVEN)
      add(path,
          path +
              " heats where the velocity-driven layer flows; under strategy force_driven plastic work heats nothing");
    if (scene_.velocity_driven().drive() == v1::DRIVE_INTERFACE_SLIP)
      add(path, path +
                    " needs drive = \"layer_shear\": with \"interface_slip\" all the work of the jump is friction at "
                    "z = 0, and heat in the layer would count it twice");
    if (!scene_.has_hard_layer() && !given_("hard_layer"))
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
    if (scene_.layer().cells() > kMaxInertiaCells)
      add(path, fmt::format("{} works with at most {} cells, found layer.cells = {}: grade them (layer.grading)", path,
                            kMaxInertiaCells, scene_.layer().cells()));
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
    if (cells > kMaxSleepCells)
      add(path, fmt::format("{} works with at most {} cells of both bodies, found {}: grade them (layer.grading)", path,
                            kMaxSleepCells, cells));
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
    if (scene_.has_junctions() || given_("junctions"))
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
      if (scene_.has_hard_layer() || given_("hard_layer"))
        add("layer.heat", "layer.heat = \"modes\" follows one body: leave out [hard_layer], or keep the profile");
    } else if (scene_.layer().has_modes() && sound("layer.heat", scene_.layer().heat() != 0)) {
      add("layer.modes", "[layer.modes] is of layer.heat = \"modes\" only");
    }
    if (scene_.layer().heat() != v1::HEAT_MODES || !sound("layer.modes.shortest_step_s", true) ||
        !sound("layer.modes.longest_time_s", true))
      return;
    with_message<v1::Scene>([&](v1::Scene& filled) {
      filled = scene_;
      fill_defaults(filled);
      const v1::HeatModes& modes = filled.layer().modes();
      if (modes.longest_time_s() < modes.shortest_step_s())
        add("layer.modes.longest_time_s",
            fmt::format("layer.modes.longest_time_s = {} s is below layer.modes.shortest_step_s = {} s",
                        number_text(modes.longest_time_s()), number_text(modes.shortest_step_s())));
    });
  }

  // The server chooses grid and method for a tolerance, for models whose error of T0 falls as both get finer.
  void tolerance() {
    if (!scene_.has_tolerance()) return;
    const v1::Layer& layer = scene_.layer();
    const v1::HardLayer& hard = scene_.hard_layer();
    const std::pair<const char*, bool> chosen[] = {{"layer.cells", layer.has_cells()},
                                                   {"layer.grading", layer.has_grading()},
                                                   {"layer.time_integrator", layer.time_integrator() != 0},
                                                   {"layer.heat", layer.heat() != 0},
                                                   {"layer.modes", layer.has_modes()},
                                                   {"layer.sleep", layer.sleep()},
                                                   {"hard_layer.cells", hard.has_cells()},
                                                   {"hard_layer.grading", hard.has_grading()}};
    for (const auto& [path, given] : chosen) {
      if (given || given_(path))
        add(path,
            fmt::format("{} is the server's choice where the scene gives a tolerance: leave out one of them", path));
    }
    if (scene_.velocity_driven().has_taylor_quinney_factor())
      add("tolerance",
          "tolerance does not go with velocity_driven.taylor_quinney_factor: where the flow gathers in a band depends "
          "on cells and steps, and no estimate can tell");
    if (layer.inertia())
      add("tolerance",
          "tolerance does not go with layer.inertia: the error is told by the interface temperature, and waves cross "
          "the layer unseen there");
  }

  void strategy() {
    if (scene_.strategy() == v1::STRATEGY_FORCE_DRIVEN && !scene_.has_interface() && !given_("interface"))
      add("strategy", "strategy force_driven needs the table [interface], which is missing");
    if (scene_.strategy() == v1::STRATEGY_VELOCITY_DRIVEN && scene_.interface().plastic_layer())
      add("interface.plastic_layer",
          "interface.plastic_layer is an option of strategy force_driven; a velocity-driven layer always flows");
  }

  // One problem, and the bodies it is about.
  void hydro() {
    const v1::Hydro& hydro = scene_.hydro();
    const auto needs = [&](const char* problem, bool present, const char* key) {
      if (!present && !given_(key)) add("", fmt::format("[{}] is missing: hydro.{} needs it", key, problem));
    };
    int problems = 0;
    const auto problem = [&](const char* name, bool present, bool soft, bool hard) {
      if (!present) return;
      ++problems;
      if (soft) needs(name, scene_.has_soft(), "soft");
      if (hard) needs(name, scene_.has_hard(), "hard");
    };
    problem("shear_column", hydro.has_shear_column(), true, true);
    problem("cone_target", hydro.has_cone_target(), true, true);
    problem("piston", hydro.has_piston(), true, false);
    problem("flyer_impact", hydro.has_flyer_impact(), true, true);
    problem("implosion", hydro.has_implosion(), true, false);
    problem("gas_flow", hydro.has_gas_flow(), false, false);
    problem("taylor_bar", hydro.has_taylor_bar(), true, false);
    problem("sliding_plates", hydro.has_sliding_plates(), true, true);
    if (problems > 1) add("hydro", fmt::format("[hydro] names {} problems, expected one", problems));
    if (hydro.interface_law() == v1::INTERFACE_LAW_CONSTANT && !hydro.has_constant_shear_stress_pa() &&
        !given_("hydro.constant_shear_stress_pa"))
      add("hydro.interface_law", "interface_law constant needs hydro.constant_shear_stress_pa, which is missing");
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

  // Paired lists hold one value for all columns or one per column; pressures may instead follow their times.
  void shear_column() {
    const v1::ShearColumn& column = scene_.hydro().shear_column();
    const int jumps = column.velocity_jump_m_per_s_size();
    const int temperatures = column.initial_temperature_k_size();
    const int pressures = column.pressure_pa_size();
    const int times = column.pressure_time_s_size();
    if (!sound(kColumn + "velocity_jump_m_per_s", jumps > 0) ||
        !sound(kColumn + "initial_temperature_k", temperatures > 0) || !sound(kColumn + "pressure_pa", pressures > 0) ||
        !sound(kColumn + "pressure_time_s", times > 0))
      return;
    if (column.lists() == v1::LISTS_COMBINED) {
      combinations(jumps, temperatures, times > 0 ? 1 : pressures);
    } else {
      const int columns = std::max({jumps, temperatures, times > 0 ? 0 : pressures});
      one_or_all("velocity_jump_m_per_s", jumps, columns);
      one_or_all("initial_temperature_k", temperatures, columns);
      if (times == 0) one_or_all("pressure_pa", pressures, columns);
    }
    if (times == 0) return;
    if (pressures != times)
      add(kColumn + "pressure_pa",
          fmt::format("{}pressure_pa has {} values, expected {} (one per pressure_time_s)", kColumn, pressures, times));
    for (int i = 1; i < times; ++i)
      if (!(column.pressure_time_s(i) > column.pressure_time_s(i - 1)))
        return add(kColumn + "pressure_time_s",
                   fmt::format("{}pressure_time_s[{}] = {} s is not after {} s, expected increasing times", kColumn, i,
                               number_text(column.pressure_time_s(i)), number_text(column.pressure_time_s(i - 1))));
  }

 private:
  void add(std::string path, std::string text) { faults_.push_back({std::move(path), std::move(text)}); }

  template <typename Table>
  bool sound_grid(const std::string& name, bool present, const Table& table) const {
    return sound(name, present) && sound(name + ".thickness_m", table.has_thickness_m()) &&
           sound(name + ".cells", table.has_cells()) && sound(name + ".grading", table.has_grading());
  }

  void first_cell(const std::string& name, bool grading_given, double thickness, std::uint32_t cells, double ratio) {
    const double sum = ratio == 1.0 ? cells : std::expm1(cells * std::log(ratio)) / (ratio - 1.0);
    const double first = thickness / sum;
    if (!(first >= kThinnestCell))
      add(name + (grading_given ? ".grading" : ".cells"),
          fmt::format("{}.grading = {} with {} cells makes the first cell {:.3g} m wide, expected at least {} m: take "
                      "fewer cells or a ratio nearer to 1",
                      name, number_text(ratio), cells, first, kThinnestCell));
  }

  bool sound(const std::string& path, bool present) const {
    return (present || !given_(path)) &&
           std::none_of(faults_.begin(), faults_.end(), [&](const Fault& fault) { return fault.path == path; });
  }

  void one_or_all(const char* key, int size, int columns) {
    if (size > 1 && size != columns)
      add(kColumn + key,
          fmt::format("{}{} has {} values, expected 1 or {} (one per column)", kColumn, key, size, columns));
  }

  void combinations(std::size_t jumps, int temperatures, std::size_t pressures) {
    const std::size_t columns =
        jumps * std::max<std::size_t>(1, temperatures) * pressures;  // each at most 2e5: no overflow
    if (columns > kMaxNodesPerSession)
      add(kColumn + "lists",
          fmt::format("{}lists combine to {} columns, expected at most {}", kColumn, columns, kMaxNodesPerSession));
  }

  inline static const std::string kColumn = "hydro.shear_column.";
  const v1::Scene& scene_;
  const std::function<bool(std::string_view)>& given_;
  std::vector<Fault>& faults_;
};

}  // namespace

std::vector<Fault> faults_of(const v1::Scene& scene, const std::function<bool(std::string_view)>& given) {
  std::vector<Fault> faults;
  Checker(given, faults).table(scene, "");
  Together together(scene, given, faults);
  together.strategy();
  together.layers();
  together.plastic_heating();
  together.inertia();
  together.sleep();
  together.components();
  together.time_integrator();
  together.tolerance();
  together.modes();
  together.hard_strength();
  if (scene.has_hydro()) together.hydro();
  together.junctions();
  together.friction();
  if (scene.hydro().has_shear_column()) together.shear_column();
  return faults;
}

std::string bounds_of(const FieldDescriptor& field) {
  const v1::Rule& rule = rule_of(field);
  std::vector<std::string> parts;
  if (rule.has_at_least()) parts.push_back("at least " + number_text(rule.at_least()));
  if (rule.has_above()) parts.push_back("above " + number_text(rule.above()));
  if (rule.has_at_most()) parts.push_back("at most " + number_text(rule.at_most()));
  if (rule.has_below()) parts.push_back("below " + number_text(rule.below()));
  return parts.empty() ? std::string() : fmt::format("{}{}", fmt::join(parts, " and "), unit_of(field));
}

std::vector<std::string> choices_of(const FieldDescriptor& field) {
  const google::protobuf::EnumDescriptor& type = *field.enum_type();
  const std::string_view unspecified = type.value(0)->name();  // FAR_BOUNDARY_UNSPECIFIED: the prefix of all
  const std::size_t prefix = unspecified.size() - std::string_view("UNSPECIFIED").size();
  std::vector<std::string> choices;
  for (int i = 1; i < type.value_count(); ++i) {
    std::string choice = type.value(i)->name().substr(prefix);
    for (char& c : choice) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    choices.push_back(std::move(choice));
  }
  return choices;
}

std::string number_text(double value) {
  std::string text = fmt::format("{}", value);  // the shortest that reads back
  if (text.ends_with(".0")) text.resize(text.size() - 2);
  // 200000000 as 2e8: no zeros to count.
  constexpr std::size_t kManyZeros = 5;
  const std::size_t last = text.find_last_not_of('0');
  const std::size_t first = text.find_first_of("123456789");
  if (first == std::string::npos || text.find_first_not_of("-0123456789") != std::string::npos ||
      text.size() - last <= kManyZeros)
    return text;
  const std::string_view all = text;
  return fmt::format("{}{}{}e{}", all.substr(0, first + 1), last > first ? "." : "",
                     all.substr(first + 1, last - first), all.size() - first - 1);
}

}  // namespace shearbus::wire
