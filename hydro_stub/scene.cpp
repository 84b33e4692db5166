#include "hydro_stub/scene.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <span>
#include <utility>

#include "proto/scene/scene.hpp"
#include "proto/wire/limits.hpp"

namespace shearbus::hydro {
namespace {

const std::string kColumn = "hydro.shear_column.";

// The problems that [hydro] may name, and which bodies they need.
struct Problem {
  const char* name;
  bool soft = true;
  bool hard = false;
};
constexpr Problem kProblems[] = {
    {"shear_column", true, true},
    {"cone_target", true, true},
    {"piston"},
    {"flyer_impact", true, true},
    {"implosion"},
    {"gas_flow", false},
    {"taylor_bar"},
    {"sliding_plates", true, true},
};

bool has_problem(const guest::Hydro& hydro, const Problem& problem) {
  return hydro.GetReflection()->HasField(hydro, hydro.GetDescriptor()->FindFieldByName(problem.name));
}

// Checks that [hydro] names exactly one problem and that the scene has the bodies which this problem needs. This rule
// and the next, between several keys, are skipped if a value that they need is itself faulty.
void check_hydro(const guest::HydroScene& scene, scene::Findings& findings) {
  const guest::Hydro& hydro = scene.hydro();
  int problems = 0;
  for (const Problem& problem : kProblems) {
    if (!has_problem(hydro, problem)) continue;
    ++problems;
    const auto needs = [&](bool needed, bool present, const char* key) {
      if (needed && !present && findings.sound(key))
        findings.add("", fmt::format("[{}] is missing: hydro.{} needs it", key, problem.name));
    };
    needs(problem.soft, scene.scene().has_soft(), "soft");
    needs(problem.hard, scene.scene().has_hard(), "hard");
  }
  if (problems > 1) findings.add("hydro", fmt::format("[hydro] names {} problems, expected one", problems));
  if (has_problem2d(hydro)) {
    const auto unused = [&](bool given, const char* key, const char* why) {
      if (given && findings.sound(key)) findings.add(key, fmt::format("{} is of shear_column alone: {}", key, why));
    };
    unused(hydro.has_dt_s(), "hydro.dt_s", "in two dimensions the step follows from the zones");
    unused(hydro.cfl() != 1.0, "hydro.cfl", "the Courant number of a cone is cone_target.courant");
    unused(scene.scene().layer().inertia() && hydro.has_cone_target(), "layer.inertia",
           "in a cone the zones next to the interface are as heavy as the layer that they hold");
  }
  if (hydro.interface_law() == guest::INTERFACE_LAW_CONSTANT && !hydro.has_constant_shear_stress_pa() &&
      findings.sound("hydro.constant_shear_stress_pa"))
    findings.add("hydro.interface_law",
                 "interface_law constant needs hydro.constant_shear_stress_pa, which is missing");
}

// Checks the lengths of the lists. A paired list holds one value for all columns or one value per column; pressure_pa
// may instead hold one value for each time in pressure_time_s.
void check_shear_column(const guest::ShearColumn& column, scene::Findings& findings) {
  const int jumps = column.velocity_jump_m_per_s_size();
  const int temperatures = column.initial_temperature_k_size();
  const int pressures = column.pressure_pa_size();
  const int times = column.pressure_time_s_size();
  for (const char* key : {"velocity_jump_m_per_s", "initial_temperature_k", "pressure_pa", "pressure_time_s"})
    if (!findings.sound(kColumn + key)) return;
  if (column.lists() == guest::LISTS_COMBINED) {
    // each of the three factors is at most 2e6 (kMaxNodesPerSession), so that the product does not overflow
    const std::size_t columns = std::size_t{1} * jumps * std::max(1, temperatures) * (times > 0 ? 1 : pressures);
    if (columns > wire::kMaxNodesPerSession)
      findings.add(kColumn + "lists", fmt::format("{}lists combine to {} columns, expected at most {}", kColumn,
                                                  columns, wire::kMaxNodesPerSession));
  } else {
    const int columns = std::max({jumps, temperatures, times > 0 ? 0 : pressures});
    const auto one_or_all = [&](const char* key, int size) {
      if (size > 1 && size != columns)
        findings.add(kColumn + key,
                     fmt::format("{}{} has {} values, expected 1 or {} (one per column)", kColumn, key, size, columns));
    };
    one_or_all("velocity_jump_m_per_s", jumps);
    one_or_all("initial_temperature_k", temperatures);
    if (times == 0) one_or_all("pressure_pa", pressures);
  }
  if (times == 0) return;
  if (pressures != times)
    findings.add(kColumn + "pressure_pa", fmt::format("{}pressure_pa has {} values, expected {} (one per "
                                                      "pressure_time_s)",
                                                      kColumn, pressures, times));
  for (int i = 1; i < times; ++i)
    if (!(column.pressure_time_s(i) > column.pressure_time_s(i - 1)))
      return findings.add(kColumn + "pressure_time_s",
                          fmt::format("{}pressure_time_s[{}] = {} s is not after {} s, expected increasing times",
                                      kColumn, i, scene::number_text(column.pressure_time_s(i)),
                                      scene::number_text(column.pressure_time_s(i - 1))));
}

void check_hydro_scene(const google::protobuf::Message& root, scene::Findings& findings) {
  const auto& scene = static_cast<const guest::HydroScene&>(root);
  scene::check_scene(scene.scene(), findings);
  if (!scene.has_hydro()) return;
  // A scene whose [hydro] problem has no shear layer needs no strategy and possibly no bodies, but always a name.
  if (scene.scene().name().empty() && findings.sound("name"))
    findings.add("", "name is missing (what the scene is called in files and logs)");
  check_hydro(scene, findings);
  if (scene.hydro().has_shear_column()) check_shear_column(scene.hydro().shear_column(), findings);
}

}  // namespace

bool has_problem2d(const guest::Hydro& hydro) {
  return std::ranges::any_of(std::span(kProblems).subspan(1), [&](const Problem& p) { return has_problem(hydro, p); });
}

SceneFile parse_scene(std::string text, const std::string& file) {
  SceneFile parsed{.scene = {}, .text = std::move(text), .document = {}};
  parsed.document = scene::read(parsed.text, file, parsed.scene, check_hydro_scene);
  return parsed;
}

SceneFile load_scene(const std::filesystem::path& path) {
  return parse_scene(scene::read_file(path), path.string());
}

std::string SceneFile::server_text() const {
  return scene::without_table(text, document.file, "hydro");
}

std::vector<std::string> SceneFile::warnings() const {
  guest::HydroScene read = scene;
  const guest::Hydro& hydro = scene.hydro();
  read.clear_scene();
  if (hydro.has_gas_flow()) read.mutable_hydro()->clear_end_time_s();  // of the order of 1 s
  std::vector<std::string> found = scene::unusual_values(read);
  const guest::CoulombTresca& law = hydro.coulomb_tresca();
  if (hydro.interface_law() == guest::INTERFACE_LAW_COULOMB_TRESCA &&
      law.friction_coefficient_fast() > law.friction_coefficient_at_rest())
    found.push_back(
        fmt::format("hydro.coulomb_tresca.friction_coefficient_fast = {} is above "
                    "friction_coefficient_at_rest = {}: friction grows with velocity. Are they swapped?",
                    law.friction_coefficient_fast(), law.friction_coefficient_at_rest()));
  for (std::string& warning : found)
    warning = fmt::format("{}: warning: {}", document.where(warning.substr(0, warning.find(' '))), warning);
  return found;
}

const std::vector<std::string>& interface_laws() {
  return scene::choices_of(*guest::Hydro::descriptor()->FindFieldByName("interface_law"));
}

const std::string& name(guest::InterfaceLaw law) {
  return interface_laws().at(static_cast<std::size_t>(law) - 1);
}

guest::InterfaceLaw interface_law(const std::string& name) {
  return static_cast<guest::InterfaceLaw>(1 + (std::ranges::find(interface_laws(), name) - interface_laws().begin()));
}

std::string reference() {
  return scene::reference_of(*guest::HydroScene::descriptor());
}

}  // namespace shearbus::hydro
