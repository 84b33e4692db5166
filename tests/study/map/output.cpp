#include "tests/study/map/output.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <fstream>
#include <stdexcept>
#include <system_error>

#include "tests/study/map/limits.hpp"

namespace shearbus::map {
namespace {

std::string json_text(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\')
      out += fmt::format("\\{}", c);
    else if (static_cast<unsigned char>(c) < 0x20)
      out += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    else
      out += c;
  }
  return out + '"';
}

std::string json_numbers(const std::vector<double>& values) {
  return fmt::format("[{}]", fmt::join(values, ", "));
}

std::string json_line(const Line& line) {
  std::vector<std::string> values;
  values.reserve(line.size());
  for (const auto& value : line) values.push_back(value ? fmt::format("{:.6g}", *value) : "null");
  return fmt::format("[{}]", fmt::join(values, ", "));
}

void save(const std::filesystem::path& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  file.close();
  if (!file)
    throw std::runtime_error(fmt::format("{}: not written: {}", path.string(), std::generic_category().message(errno)));
}

std::string nodes_csv(const Map& map) {
  std::string text =
      "time_s,pressure_pa,velocity_jump_m_per_s,shear_stress_pa,friction_coefficient,slip_carried_m,slip_share,"
      "interface_temperature_k,regime,melting_time_s\n";
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

std::string map_json(const Map& map, const std::string& scene_name, const std::string& version) {
  std::string text = fmt::format(
      "{{\n  \"producer\": {},\n  \"server_version\": {},\n  \"scene_name\": {},\n  \"effective_scene\": {},\n  "
      "\"dt_s\": {},\n  \"domain_share\": {},\n  \"pressure_pa\": {},\n  \"velocity_jump_m_per_s\": {},\n  "
      "\"observations\": [\n",
      json_text("shearbus-study " + version), json_text(map.server_version), json_text(scene_name),
      json_text(map.effective_scene), map.dt_s, kDomainShare, json_numbers(map.axes.pressure_pa),
      json_numbers(map.axes.velocity_m_per_s));
  for (std::size_t k = 0; k < map.observations.size(); ++k) {
    const Observation& seen = map.observations[k];
    text += fmt::format(
        "    {{\"time_s\": {},\n     \"sticking_below_m_per_s\": {},\n     \"domain_limit_m_per_s\": {},\n     "
        "\"melting_above_m_per_s\": {}}}{}\n",
        seen.time_s, json_line(velocity_of_share(map, seen, 0.0)),
        json_line(velocity_of_share(map, seen, kDomainShare)), json_line(velocity_of_melting(map, seen.time_s)),
        k + 1 < map.observations.size() ? "," : "");
  }
  return text + "  ]\n}\n";
}

}  // namespace

void write(const Map& map, const std::string& scene_name, const std::string& version,
           const std::filesystem::path& out) {
  std::filesystem::create_directories(out);
  save(out / "nodes.csv", nodes_csv(map));
  save(out / "map.json", map_json(map, scene_name, version));
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
