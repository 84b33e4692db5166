#include "client/study/map/output.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <system_error>

#include "client/study/map/limits.hpp"
#include "proto/files/whole_file.hpp"

namespace shearbus::map {
namespace {

constexpr const char* kNodesHeader =
    "time_s,pressure_pa,velocity_jump_m_per_s,shear_stress_pa,friction_coefficient,slip_carried_m,slip_share,"
    "interface_temperature_k,regime,melting_time_s\n";

constexpr files::FileKind kNodesFile = {
    "a table of nodes of shearbus-study map",
    [](const std::filesystem::path& file) { return files::head_of(file, 32).starts_with("time_s,pressure_pa,"); }};

std::string nodes_csv(const Map& map) {
  std::string text = kNodesHeader;
  for (const Observation& seen : map.observations) {
    const std::vector<double> shares = slip_share(map, seen);
    for (std::size_t p = 0; p < map.axes.pressure_pa.size(); ++p) {
      for (std::size_t v = 0; v < map.axes.velocity_m_per_s.size(); ++v) {
        const std::size_t i = map.axes.node(p, v);
        const double melted = map.melting_time_s[i];
        text += fmt::format("{},{},{},{},{},{},{},{},{},{}\n", seen.time_s, map.axes.pressure_pa[p],
                            map.axes.velocity_m_per_s[v], seen.shear_stress_pa[i],
                            seen.shear_stress_pa[i] / map.axes.pressure_pa[p], seen.slip_m[i], shares[i],
                            seen.interface_temperature_k[i], seen.regime[i],
                            std::isnan(melted) ? std::string() : fmt::format("{}", melted));
      }
    }
  }
  return text;
}

// Returns the line as a JSON array with the velocity at each pressure, or null where it lies outside the map.
nlohmann::ordered_json json_of(const Line& line) {
  auto values = nlohmann::ordered_json::array();
  for (const auto& value : line) values.push_back(value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json());
  return values;
}

nlohmann::ordered_json map_json(const Map& map, const std::string& scene_name, const server::Entries& provenance) {
  nlohmann::ordered_json out = {{"producer", "shearbus-study " + server::value_of(provenance, "version")},
                                {"server_version", map.server_version},
                                {"scene_name", scene_name},
                                {"effective_scene", map.effective_scene},
                                {"dt_s", map.dt_s},
                                {"domain_share", kDomainShare},
                                {"pressure_pa", map.axes.pressure_pa},
                                {"velocity_jump_m_per_s", map.axes.velocity_m_per_s}};
  for (const auto& [key, value] : provenance) out["provenance"][key] = value;
  for (const Observation& seen : map.observations)
    out["observations"].push_back({{"time_s", seen.time_s},
                                   {"sticking_below_m_per_s", json_of(velocity_of_share(map, seen, 0.0))},
                                   {"domain_limit_m_per_s", json_of(velocity_of_share(map, seen, kDomainShare))},
                                   {"melting_above_m_per_s", json_of(velocity_of_melting(map, seen.time_s))}});
  return out;
}

}  // namespace

void write(const Map& map, const std::string& scene_name, const server::Entries& provenance,
           const std::filesystem::path& out) {
  const files::OneWriter writer(out);
  files::write_whole(out / "nodes.csv", kNodesFile, nodes_csv(map));
  files::write_whole(out / "map.json", files::kSummaryFile, map_json(map, scene_name, provenance).dump(1) + '\n');
}

std::string summary(const Map& map) {
  const std::vector<double>& P = map.axes.pressure_pa;
  const auto ends = [](const Line& line) {
    const auto end = [](const std::optional<double>& v) {
      return v ? fmt::format("{:8.3g}", *v) : std::string("       -");
    };
    return fmt::format("{} {}", end(line.front()), end(line.back()));
  };
  std::string text = fmt::format(
      "{} pressures x {} velocities, dt {:g} s\n"
      "velocity (m/s) at {:g} and {:g} GPa: sticking below, {:.0f} % of the slip carried, melting above\n",
      P.size(), map.axes.velocity_m_per_s.size(), map.dt_s, 1e-9 * P.front(), 1e-9 * P.back(), 100.0 * kDomainShare);
  for (const Observation& seen : map.observations) {
    text += fmt::format("  {:>8.3g} s  {}  {}  {}\n", seen.time_s, ends(velocity_of_share(map, seen, 0.0)),
                        ends(velocity_of_share(map, seen, kDomainShare)), ends(velocity_of_melting(map, seen.time_s)));
  }
  return text;
}

}  // namespace shearbus::map
