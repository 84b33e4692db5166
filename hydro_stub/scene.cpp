#include "hydro_stub/scene.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "proto/scene/scene.hpp"
#include "proto/wire/limits.hpp"

namespace shearbus::hydro {
namespace {

const std::string kColumn = "hydro.shear_column.";

// Rules between several keys of [hydro], and between [hydro] and the rest of the scene. A rule is skipped if a value
// that it needs is itself faulty.
class CrossChecks {
 public:
  CrossChecks(const guest::HydroScene& scene, scene::Findings& findings) : scene_(scene), findings_(findings) {}

  // Checks that [hydro] names exactly one problem and that the scene has the bodies which this problem needs.
  void hydro() {
    const guest::Hydro& hydro = scene_.hydro();
    const auto needs = [&](const char* problem, bool present, const char* key) {
      if (!present && sound(key)) add("", fmt::format("[{}] is missing: hydro.{} needs it", key, problem));
    };
    int problems = 0;
    const auto problem = [&](const char* name, bool present, bool soft, bool hard) {
      if (!present) return;
      ++problems;
      if (soft) needs(name, scene_.scene().has_soft(), "soft");
      if (hard) needs(name, scene_.scene().has_hard(), "hard");
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
    if (hydro.interface_law() == guest::INTERFACE_LAW_CONSTANT && !hydro.has_constant_shear_stress_pa() &&
        sound("hydro.constant_shear_stress_pa"))
      add("hydro.interface_law", "interface_law constant needs hydro.constant_shear_stress_pa, which is missing");
  }

  // Checks the lengths of the lists. A paired list holds one value for all columns or one value per column; pressure_pa
  // may instead hold one value for each time in pressure_time_s.
  void shear_column() {
    const guest::ShearColumn& column = scene_.hydro().shear_column();
    const int jumps = column.velocity_jump_m_per_s_size();
    const int temperatures = column.initial_temperature_k_size();
    const int pressures = column.pressure_pa_size();
    const int times = column.pressure_time_s_size();
    if (!sound(kColumn + "velocity_jump_m_per_s") || !sound(kColumn + "initial_temperature_k") ||
        !sound(kColumn + "pressure_pa") || !sound(kColumn + "pressure_time_s"))
      return;
    if (column.lists() == guest::LISTS_COMBINED) {
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
                               scene::number_text(column.pressure_time_s(i)),
                               scene::number_text(column.pressure_time_s(i - 1))));
  }

 private:
  void add(std::string path, std::string text) { findings_.add(std::move(path), std::move(text)); }
  bool sound(std::string_view path) const { return findings_.sound(path); }

  void one_or_all(const char* key, int size, int columns) {
    if (size > 1 && size != columns)
      add(kColumn + key,
          fmt::format("{}{} has {} values, expected 1 or {} (one per column)", kColumn, key, size, columns));
  }

  void combinations(std::size_t jumps, int temperatures, std::size_t pressures) {
    const std::size_t columns =
        // each of the three factors is at most 2e6 (kMaxNodesPerSession), so that the product does not overflow
        jumps * std::max<std::size_t>(1, temperatures) * pressures;
    if (columns > wire::kMaxNodesPerSession)
      add(kColumn + "lists", fmt::format("{}lists combine to {} columns, expected at most {}", kColumn, columns,
                                         wire::kMaxNodesPerSession));
  }

  const guest::HydroScene& scene_;
  scene::Findings& findings_;
};

void check_hydro_scene(const google::protobuf::Message& root, scene::Findings& findings) {
  const auto& scene = static_cast<const guest::HydroScene&>(root);
  scene::check_scene(scene.scene(), findings);
  if (!scene.has_hydro()) return;
  // A scene whose [hydro] problem has no shear layer needs no strategy and possibly no bodies, but always a name.
  if (scene.scene().name().empty() && findings.sound("name"))
    findings.add("", "name is missing (what the scene is called in files and logs)");
  CrossChecks checks(scene, findings);
  checks.hydro();
  if (scene.hydro().has_shear_column()) checks.shear_column();
}

}  // namespace

SceneFile parse_scene(std::string text, std::string file) {
  SceneFile parsed{.scene = {}, .text = std::move(text), .document = {}};
  parsed.document = scene::read(parsed.text, std::move(file), parsed.scene, check_hydro_scene);
  return parsed;
}

SceneFile load_scene(const std::filesystem::path& path) {
  return parse_scene(scene::read_file(path), path.string());
}

std::string SceneFile::server_text() const {
  return scene::without_table(text, document.file, "hydro");
}

std::string reference() {
  return scene::reference_of(*guest::HydroScene::descriptor());
}

}  // namespace shearbus::hydro
