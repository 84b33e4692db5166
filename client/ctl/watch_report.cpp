#include "client/ctl/watch_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <nlohmann/json.hpp>
#include <span>

#include "proto/wire/enum_names.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::ctl {
namespace {

constexpr std::size_t kHottest = 3;
constexpr std::size_t kSessionsAsked = 8;  // sessions whose hottest nodes are asked for: those with the most nodes

const wire::Histogram* steps_of(const wire::ServerStatus& status) {
  for (const wire::Histogram& histogram : status.histograms)
    if (histogram.name == "request" && histogram.verb == "downscale") return &histogram;
  return nullptr;
}

}  // namespace

std::string label_of(const wire::SessionInfo& session) {
  return session.name + ' ' + wire::hexadecimal(std::span(session.session_id).first(4));
}

void inspect(Operator& server, Sample& sample) {
  sample.sessions = server.sessions();
  std::ranges::stable_sort(sample.sessions, std::greater<>(), &wire::SessionInfo::nodes);
  for (std::size_t i = 0; i < std::min(kSessionsAsked, sample.sessions.size()); ++i) {
    const wire::SessionInfo& session = sample.sessions[i];
    try {
      const TopNodes top = server.top_nodes(session.session_id, wire::Top::kHottest, kHottest);
      for (std::size_t n = 0; n < top.node_ids.size(); ++n)
        sample.hottest.push_back({label_of(session), top.node_ids[n], top.interface_temperature_k[n], top.regime[n]});
    } catch (const Error& fault) {
      if (fault.status().code != Code::kUnknownSession) throw;  // closed meanwhile
    }
  }
  std::ranges::stable_sort(sample.hottest, std::greater<>(), &HotNode::temperature_k);
  if (sample.hottest.size() > kHottest) sample.hottest.resize(kHottest);
}

Report report_of(const Sample& now, const std::optional<Sample>& before) {
  Report report{.sample = &now, .fault = {}};
  if (!before || now.status.uptime_ns <= before->status.uptime_ns) return report;  // another server
  const wire::ServerStatus &a = before->status, &b = now.status;
  const double elapsed_s = seconds(b.uptime_ns - a.uptime_ns);
  const auto rate = [&](std::uint64_t from, std::uint64_t to) {
    return to < from ? 0.0 : static_cast<double>(to - from) / elapsed_s;
  };
  report.node_steps_per_s = rate(a.node_steps, b.node_steps);
  report.requests_per_s = rate(a.requests, b.requests);
  report.solver_share = 1e-9 * rate(a.solver_ns, b.solver_ns);
  if (!now.is_operator) return report;
  report.journal_bytes_per_s = rate(a.journal_bytes, b.journal_bytes);
  if (const wire::Histogram* const steps = steps_of(b)) {
    std::vector<std::uint64_t> counts = steps->counts;
    if (const wire::Histogram* const earlier = steps_of(a))
      for (std::size_t i = 0; i < std::min(counts.size(), earlier->counts.size()); ++i)
        counts[i] -= std::min(counts[i], earlier->counts[i]);
    report.half_below_s = quantile(counts, 0.5);
    report.most_below_s = quantile(counts, 0.99);
  }
  return report;
}

std::string scaled(double value) {
  constexpr std::array<const char*, 5> kPrefixes = {"", "k", "M", "G", "T"};
  std::size_t prefix = 0;
  while (value >= 999.5 && prefix + 1 < kPrefixes.size()) {
    value /= 1000;
    ++prefix;
  }
  return fmt::format("{:.3g} {}", value, kPrefixes[prefix]);
}
std::string scaled(const std::optional<double>& value) {
  return value ? scaled(*value) : std::string("- ");
}
std::uint64_t nodes_in_regimes(const wire::ServerStatus& status) {
  std::uint64_t all = 0;
  for (const std::uint64_t count : status.regimes) all += count;
  return all;
}

double percent(std::uint64_t part, std::uint64_t all) {
  return all == 0 ? 0.0 : 100.0 * static_cast<double>(part) / static_cast<double>(all);
}

std::string age_of_checkpoint(const wire::ServerStatus& status) {
  return status.checkpoint_age_ns != 0 ? duration(seconds(status.checkpoint_age_ns)) + " ago" : "none yet";
}

std::string line_of(const Report& report) {
  if (report.sample == nullptr) return fmt::format("{} no answer: {}", wire::utc_now(), report.fault);
  const wire::ServerStatus& s = report.sample->status;
  std::string text =
      fmt::format("{} {}, {}:", wire::utc_now(), wire::counted(s.sessions, "session"), wire::counted(s.nodes, "node"));
  for (const auto& [regime, nodes] : regimes_of(s))
    text += fmt::format(" {} {:.1f}%", regime, percent(nodes, nodes_in_regimes(s)));
  text += fmt::format("; {}node-steps/s", scaled(report.node_steps_per_s));
  if (report.sample->is_operator)
    text += fmt::format(", p50 {}, p99 {}", duration(report.half_below_s), duration(report.most_below_s));
  if (report.sample->is_operator && report.sample->is_durable)
    text += fmt::format("; journal {}B/s, checkpoint {}", scaled(report.journal_bytes_per_s), age_of_checkpoint(s));
  for (const HotNode& hot : report.sample->hottest)
    text += fmt::format("{} {:.1f} K", &hot == report.sample->hottest.data() ? "; hottest" : ",", hot.temperature_k);
  return text;
}

std::string json_of(const Report& report) {
  nlohmann::ordered_json line = {{"time", wire::utc_now()}, {"answers", report.sample != nullptr}};
  if (report.sample == nullptr) {
    line["fault"] = report.fault;
    return line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
  }
  const auto number = [](const std::optional<double>& value) {
    return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json();
  };
  const wire::ServerStatus& s = report.sample->status;
  line.update({{"server_version", s.server_version},
               {"uptime_s", seconds(s.uptime_ns)},
               {"draining", s.draining},
               {"sessions", s.sessions},
               {"nodes", s.nodes},
               {"state_bytes", s.state_bytes}});
  for (const auto& [regime, nodes] : regimes_of(s)) line["regimes"][regime] = nodes;
  line.update({{"node_steps_per_s", number(report.node_steps_per_s)},
               {"requests_per_s", number(report.requests_per_s)},
               {"solver_s_per_s", number(report.solver_share)}});
  if (report.sample->is_operator) {
    line.update({{"p50_s", number(report.half_below_s)},
                 {"p99_s", number(report.most_below_s)},
                 {"journal_bytes_per_s", number(report.journal_bytes_per_s)},
                 {"checkpoint_age_s", s.checkpoint_age_ns != 0 ? nlohmann::ordered_json(seconds(s.checkpoint_age_ns))
                                                               : nlohmann::ordered_json()}});
    line["hottest"] = nlohmann::ordered_json::array();
    for (const HotNode& hot : report.sample->hottest)
      line["hottest"].push_back({{"session", hot.session},
                                 {"node", hot.node},
                                 {"interface_temperature_k", hot.temperature_k},
                                 {"regime", wire::regime_name(hot.regime)}});
  }
  return line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace shearbus::ctl
