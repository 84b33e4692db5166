#include "client/ctl/watch_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <vector>

#include "proto/wire/enum_names.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::ctl {
namespace {

constexpr std::size_t kHottest = 3;
constexpr std::size_t kSessionsAsked = 8;  // sessions whose hottest nodes are asked for: those with the most nodes

// The counts of the histogram of steps; none where the server has not told it.
std::vector<std::uint64_t> steps_of(const Json& status) {
  for (const Json& histogram : status.at("histograms"))
    if (text(histogram, "name") == "request" && text(histogram, "verb") == "downscale") return histogram.at("counts");
  return {};
}

// Puts those with the most of a field first.
void sort_by(std::vector<Json>& answers, const char* field) {
  std::ranges::stable_sort(answers, std::greater<>(),
                           [&](const Json& answer) { return answer.at(field).get<double>(); });
}

}  // namespace

std::string label_of(const Json& session) {
  return text(session, "name") + ' ' + text(session, "session_id").substr(0, 8);
}

void inspect(Operator& server, Sample& sample) {
  sample.sessions = sessions_of(server).get<std::vector<Json>>();
  sort_by(sample.sessions, "nodes");
  for (std::size_t i = 0; i < std::min(kSessionsAsked, sample.sessions.size()); ++i) {
    const Json& session = sample.sessions[i];
    try {
      const Json top = top_nodes(server, session, wire::Top::kHottest, kHottest);
      for (std::size_t n = 0; n < top.value("node_id", Json()).size(); ++n)
        sample.hottest.push_back({{"session", label_of(session)},
                                  {"node", top.at("node_id")[n]},
                                  {"interface_temperature_k", top.at("interface_temperature_k")[n]},
                                  {"regime", wire::regime_name(top.at("regime")[n].get<std::uint64_t>())}});
    } catch (const Error& fault) {
      if (fault.status().code != Code::kUnknownSession) throw;  // closed meanwhile
    }
  }
  sort_by(sample.hottest, "interface_temperature_k");
  if (sample.hottest.size() > kHottest) sample.hottest.resize(kHottest);
}

Report report_of(const Sample& now, const std::optional<Sample>& before) {
  const Json& s = now.status;
  Json line = {{"time", wire::utc_now()}, {"answers", true}};
  line.update(fields_of(s, {"server_version", "uptime_s", "draining", "sessions", "nodes", "state_bytes"}));
  for (const auto& [regime, nodes] : regimes_of(s)) line["regimes"][regime] = nodes;

  const std::uint64_t since_ns = before ? count(before->status, "uptime_ns") : 0, until_ns = count(s, "uptime_ns");
  const bool same_server = before && since_ns < until_ns;
  const auto rate = [&](const char* field, double factor = 1.0) {
    if (!same_server) return Json();
    const std::uint64_t from = count(before->status, field), to = count(s, field);
    return Json(to < from ? 0.0 : factor * (static_cast<double>(to - from) / seconds(until_ns - since_ns)));
  };
  line.update({{"node_steps_per_s", rate("node_steps")},
               {"requests_per_s", rate("requests")},
               {"solver_s_per_s", rate("solver_ns", 1e-9)}});
  if (now.is_operator) {
    std::vector<std::uint64_t> counts = same_server ? steps_of(s) : std::vector<std::uint64_t>();
    const auto earlier = same_server ? steps_of(before->status) : std::vector<std::uint64_t>();
    for (std::size_t i = 0; i < std::min(counts.size(), earlier.size()); ++i)
      counts[i] -= std::min(counts[i], earlier[i]);
    const auto of_steps = [&](double share) {
      const std::optional<double> found = quantile(counts, share);
      return found ? Json(*found) : Json();
    };
    const double age_s = seconds(s, "checkpoint_age_ns");
    line.update({{"p50_s", of_steps(0.5)},
                 {"p99_s", of_steps(0.99)},
                 {"journal_bytes_per_s", rate("journal_bytes")},
                 {"checkpoint_age_s", age_s != 0.0 ? Json(age_s) : Json()},
                 {"hottest", now.hottest}});
  }
  return {.sample = &now, .line = std::move(line)};
}

Report report_of(const Error& fault) {
  return {.line = {{"time", wire::utc_now()}, {"answers", false}, {"fault", describe(fault.status())}}};
}

std::optional<double> number(const Report& report, const char* field) {
  const Json& value = report.line.at(field);
  return value.is_null() ? std::nullopt : std::optional(value.get<double>());
}

std::string scaled(std::optional<double> value) {
  constexpr std::array<const char*, 5> kPrefixes = {"", "k", "M", "G", "T"};
  if (!value) return "- ";
  std::size_t prefix = 0;
  while (*value >= 999.5 && prefix + 1 < kPrefixes.size()) {
    *value /= 1000;
    ++prefix;
  }
  return fmt::format("{:.3g} {}", *value, kPrefixes[prefix]);
}

std::uint64_t nodes_in_regimes(const Json& status) {
  std::uint64_t all = 0;
  for (const Json& nodes : status.at("regimes")) all += nodes.get<std::uint64_t>();
  return all;
}

double percent(std::uint64_t part, std::uint64_t all) {
  return all == 0 ? 0.0 : 100.0 * static_cast<double>(part) / static_cast<double>(all);
}

std::string age_of_checkpoint(const Json& status) {
  const double age_s = seconds(status, "checkpoint_age_ns");
  return age_s != 0.0 ? duration(age_s) + " ago" : "none yet";
}

std::string line_of(const Report& report) {
  const std::string time = text(report.line, "time");
  if (report.sample == nullptr) return fmt::format("{} no answer: {}", time, text(report.line, "fault"));
  const Sample& sample = *report.sample;
  const Json& s = sample.status;
  std::string line = fmt::format("{} {}, {}:", time, wire::counted(count(s, "sessions"), "session"),
                                 wire::counted(count(s, "nodes"), "node"));
  for (const auto& [regime, nodes] : regimes_of(s))
    line += fmt::format(" {} {:.1f}%", regime, percent(nodes, nodes_in_regimes(s)));
  line += fmt::format("; {}node-steps/s", scaled(number(report, "node_steps_per_s")));
  if (sample.is_operator)
    line += fmt::format(", p50 {}, p99 {}", duration(number(report, "p50_s")), duration(number(report, "p99_s")));
  if (sample.is_operator && sample.is_durable)
    line += fmt::format("; journal {}B/s, checkpoint {}", scaled(number(report, "journal_bytes_per_s")),
                        age_of_checkpoint(s));
  for (const Json& hot : sample.hottest)
    line += fmt::format("{} {:.1f} K", &hot == sample.hottest.data() ? "; hottest" : ",",
                        hot.at("interface_temperature_k").get<double>());
  return line;
}

}  // namespace shearbus::ctl
