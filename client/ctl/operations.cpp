#include "client/ctl/operations.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <future>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "proto/files/endpoint_file.hpp"
#include "proto/wire/enum_names.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::ctl {
namespace {

void show(const char* what, const std::string& value) {
  fmt::print("{:<12} {}\n", what, value);
}

nlohmann::ordered_json json_of(const Told& told) {
  const wire::ServerStatus& s = told.status;
  auto regimes = nlohmann::ordered_json::object();
  for (const auto& [regime, nodes] : regimes_of(s)) regimes[regime] = nodes;
  nlohmann::ordered_json json = {{"server_version", s.server_version},
                                 {"uptime_s", seconds(s.uptime_ns)},
                                 {"threads", s.threads},
                                 {"sessions", s.sessions},
                                 {"nodes", s.nodes},
                                 {"state_bytes", s.state_bytes},
                                 {"requests", s.requests},
                                 {"refused", s.refused},
                                 {"replayed", s.replayed},
                                 {"node_steps", s.node_steps},
                                 {"solver_s", seconds(s.solver_ns)},
                                 {"draining", s.draining},
                                 {"regimes", regimes}};
  if (told.is_operator)
    json.update({{"checkpoints", s.checkpoints},
                 {"journal_bytes", s.journal_bytes},
                 {"longest_turn_s", seconds(s.longest_turn_ns)},
                 {"resident_bytes", s.resident_bytes},
                 {"open_files", s.open_files}});
  return json;
}

void show_json(const wire::SessionInfo& s) {
  const nlohmann::ordered_json line = {{"session", wire::hexadecimal(s.session_id)},
                                       {"name", s.name},
                                       {"identity", s.identity},
                                       {"domain", s.domain},
                                       {"nodes", s.nodes},
                                       {"state_version", s.state_version},
                                       {"last_sequence", s.last_sequence},
                                       {"trial_stands", s.trial_stands},
                                       {"age_s", seconds(s.age_ns)},
                                       {"idle_s", seconds(s.idle_ns)},
                                       {"idle_limit_s", s.idle_limit_s},
                                       {"state_bytes", s.state_bytes},
                                       {"node_steps", s.node_steps},
                                       {"solver_s", seconds(s.solver_ns)}};
  fmt::print("{}\n", line.dump());
}

const wire::SessionInfo& find(const std::vector<wire::SessionInfo>& sessions, const std::string& wanted) {
  const wire::SessionInfo* found = nullptr;
  for (const wire::SessionInfo& session : sessions) {
    if (!wanted.empty() && !wire::hexadecimal(session.session_id).starts_with(wanted) && session.name != wanted)
      continue;
    if (found != nullptr && wanted.empty())
      throw std::runtime_error(
          "several sessions are open; name one by its id or scene, as shearbus-ctl sessions shows it");
    if (found != nullptr)
      throw std::runtime_error(
          fmt::format("more than one session is meant by \"{}\"; give more digits of its id, as "
                      "shearbus-ctl sessions shows it",
                      wanted));
    found = &session;
  }
  if (found == nullptr && sessions.empty()) throw std::runtime_error("no session is open");
  if (found == nullptr)
    throw std::runtime_error(
        fmt::format("no open session has an id that begins with, or a scene called, \"{}\"", wanted));
  return *found;
}

// Refuses to close a session that may still be at work.
void check_idle(const wire::SessionInfo& session, double idle_s) {
  if (seconds(session.idle_ns) >= idle_s) return;
  throw std::runtime_error(
      fmt::format("session {} was at work {:.1f} s ago: it is closed only after {} s without a "
                  "request (--idle), for its states are lost then",
                  wire::hexadecimal(session.session_id), seconds(session.idle_ns), idle_s));
}

// A session whose texts, which are its user's, are as a terminal may have them.
wire::SessionInfo printable(wire::SessionInfo session) {
  for (std::string* text : {&session.name, &session.identity, &session.domain})
    *text = wire::printable(*text, wire::kMaxTextBytes);
  return session;
}

void close_one(Operator& server, const wire::SessionInfo& session) {
  const wire::SessionClosed closed = server.close(session);
  const wire::SessionInfo shown = printable(session);
  fmt::print("{} closed: \"{}\" of {}, {}, {}; its states are gone\n", wire::hexadecimal(session.session_id),
             shown.name, shown.identity, wire::counted(session.nodes, "node"),
             wire::counted(closed.requests, "request"));
}

}  // namespace

std::optional<double> quantile(std::span<const std::uint64_t> counts, double share) {
  std::uint64_t all = 0;
  for (const std::uint64_t count : counts) all += count;
  if (all == 0) return std::nullopt;
  std::uint64_t below = 0;
  double bound_s = seconds(wire::kHistogramBaseNs);
  for (const std::uint64_t count : counts) {
    below += count;
    if (static_cast<double>(below) >= share * static_cast<double>(all)) break;
    bound_s *= 2;
  }
  return bound_s;
}

std::string duration(const std::optional<double>& seconds) {
  if (!seconds) return "-";
  const double s = *seconds;
  if (s < 1e-3) return fmt::format("{:.0f} us", 1e6 * s);
  if (s < 1.0) return fmt::format("{:.0f} ms", 1e3 * s);
  if (s < 180.0) return fmt::format("{:.0f} s", s);
  return s < 3 * 3600.0 ? fmt::format("{:.0f} min", s / 60) : fmt::format("{:.1f} h", s / 3600);
}

std::vector<std::pair<std::string, std::uint64_t>> regimes_of(const wire::ServerStatus& status) {
  std::vector<std::pair<std::string, std::uint64_t>> counts;
  for (std::size_t r = 0; r < std::min(status.regimes.size(), wire::kRegimeCount); ++r)
    counts.emplace_back(wire::regime_name(r), status.regimes[r]);
  return counts;
}

void show_ping(const Operator& server, const std::string& endpoint, double answered_ms) {
  const auto& welcome = server.welcome();
  fmt::print("{}: server {}, protocol {}.{}, knows you by {}, answered in {:.1f} ms\n", endpoint,
             welcome.server_version, welcome.protocol_major, welcome.protocol_minor, welcome.access, answered_ms);
}

Told told_by(Operator& server) {
  const std::vector<std::string>& can = server.welcome().capabilities;
  const auto knows = [&](const char* capability) { return std::ranges::find(can, capability) != can.end(); };
  return {.status = server.server_status(),
          .is_operator = knows("operator"),
          .is_durable = server.welcome().durability != "none"};
}

void show_status(const Told& told, bool json) {
  const wire::ServerStatus& s = told.status;
  if (json) return fmt::print("{}\n", json_of(told).dump());
  show("server", fmt::format("{} ({} threads), up {:.0f} s{}", s.server_version, s.threads, seconds(s.uptime_ns),
                             s.draining ? ", draining: no new sessions" : ""));
  show("sessions", fmt::format("{}{} with {}, {:.1f} MB of states", s.sessions, told.is_operator ? "" : " of yours",
                               wire::counted(s.nodes, "node"), static_cast<double>(s.state_bytes) / (1 << 20)));
  std::string regimes;
  for (const auto& [regime, nodes] : regimes_of(s))
    regimes += fmt::format("{}{} {}", regimes.empty() ? "" : ", ", regime, nodes);
  if (!regimes.empty()) show("regimes", regimes);
  show("requests", fmt::format("{} ({} refused, {} repeated)", s.requests, s.refused, s.replayed));
  for (const wire::Refusals& refusals : s.refusals)
    show("", fmt::format("refused {}: {}", name(static_cast<wire::Code>(refusals.code)), refusals.count));
  const double per_step_ns =
      s.node_steps == 0 ? 0.0 : static_cast<double>(s.solver_ns) / static_cast<double>(s.node_steps);
  show("node-steps",
       fmt::format("{} in {:.3f} s of solver time ({:.0f} ns each)", s.node_steps, seconds(s.solver_ns), per_step_ns));
  for (const wire::Histogram& histogram : s.histograms)
    if (histogram.verb == "downscale" || histogram.name.starts_with("journal") || histogram.name == "checkpoint")
      show(histogram.verb.empty() ? histogram.name.c_str() : histogram.verb.c_str(),
           fmt::format("half below {}, 99 % below {}", duration(quantile(histogram.counts, 0.5)),
                       duration(quantile(histogram.counts, 0.99))));
  if (!told.is_operator) return show("", "all users, journal and process: told to operators");
  show("journal", told.is_durable ? fmt::format("{} requests, {:.1f} MB; {} checkpoints ({} failed)", s.journal_records,
                                                static_cast<double>(s.journal_bytes) / (1 << 20), s.checkpoints,
                                                s.checkpoints_failed)
                                  : "none: the server was started without --state-dir");
  show("connections", fmt::format("{} admitted, {} refused{}", s.connections_admitted, s.connections_refused,
                                  s.admitting ? "" : "; NOBODY NEW IS ADMITTED: restart the server"));
  show("turns", fmt::format("one request kept the others waiting for {:.0f} ms of processor time at most",
                            1e-6 * static_cast<double>(s.longest_turn_ns)));
  show("process", fmt::format("{:.1f} MB resident, {} of {} files open",
                              static_cast<double>(s.resident_bytes) / (1 << 20), s.open_files, s.max_open_files));
}

ServerList servers_of(const std::filesystem::path& directory) {
  ServerList servers;
  for (const auto& file : files::endpoint_files(directory))
    servers.emplace_back(file.filename(), std::string(files::kFileScheme) + file.string());
  return servers;
}

bool show_all(const std::filesystem::path& directory, bool json, const StatusOf& status_of) {
  bool all_answer = true;
  constexpr std::size_t kLongestName = 1024;
  constexpr std::size_t kLongestFault = 4096;
  std::vector<std::pair<std::string, std::future<Told>>> asked;
  for (const auto& [file, endpoint] : servers_of(directory))
    asked.emplace_back(wire::printable(file, kLongestName), std::async(std::launch::async, status_of, endpoint));
  for (auto& [name, answer] : asked) {
    try {
      const Told told = answer.get();
      const wire::ServerStatus& s = told.status;
      if (json) {
        nlohmann::ordered_json line = {{"file", name}};
        line.update(json_of(told));
        fmt::print("{}\n", line.dump());
      } else {
        fmt::print("{:<20} {}{} with {}, {} ({} refused), up {:.0f} s{}\n", name, wire::counted(s.sessions, "session"),
                   told.is_operator ? "" : " of yours", wire::counted(s.nodes, "node"),
                   wire::counted(s.requests, "request"), s.refused, seconds(s.uptime_ns),
                   s.draining ? ", draining" : "");
      }
    } catch (const Error& fault) {
      all_answer = false;
      if (json)
        fmt::print(
            "{}\n",
            nlohmann::ordered_json{{"file", name}, {"fault", wire::printable(fault.what(), kLongestFault)}}.dump());
      else
        fmt::print("{:<20} {}\n", name, wire::printable(fault.what(), kLongestFault));
    }
  }
  return all_answer;
}

void show_sessions(Operator& server, bool json) {
  const auto sessions = server.sessions();
  if (!json)
    fmt::print("{:<32} {:>8} {:>8} {:>9} {:>8} {:>8}  {}\n", "session", "nodes", "version", "last seq", "age, s",
               "idle, s", "scene, opened by");
  for (const wire::SessionInfo& session : sessions) {
    const wire::SessionInfo s = json ? session : printable(session);
    if (json)
      show_json(s);
    else
      fmt::print("{:<32} {:>8} {:>8} {:>9} {:>8.0f} {:>8.0f}  {}, {}{}\n", wire::hexadecimal(s.session_id), s.nodes,
                 s.state_version, s.last_sequence, seconds(s.age_ns), seconds(s.idle_ns), s.name, s.identity,
                 (s.domain.empty() ? "" : ", domain " + s.domain) + (s.trial_stands ? ", a trial stands" : ""));
  }
}

void show_top(Operator& server, const std::string& session, wire::Top by, std::uint32_t count) {
  const auto sessions = server.sessions();
  const TopNodes top = server.top_nodes(find(sessions, session).session_id, by, count);
  fmt::print("{} ({}, version {}): {} of {}\n", printable(top.session).name, wire::counted(top.session.nodes, "node"),
             top.session.state_version, top.node_ids.size(), top.matching);
  const bool sliding = !top.sliding_velocity_m_per_s.empty();
  fmt::print("{:>20} {:>12} {:>14} {:>8}{}\n", "node", "T0, K", "s, MPa", "regime", sliding ? "       [v], m/s" : "");
  for (std::size_t i = 0; i < top.node_ids.size(); ++i) {
    fmt::print("{:>20} {:>12.3f} {:>14.6f} {:>8}", top.node_ids[i], top.interface_temperature_k[i],
               1e-6 * top.shear_stress_pa[i], wire::regime_name(top.regime[i]));
    if (sliding) fmt::print(" {:>14.6f}", top.sliding_velocity_m_per_s[i]);
    fmt::print("\n");
  }
}

void close(Operator& server, const std::string& session, double idle_s) {
  const auto sessions = server.sessions();
  const wire::SessionInfo& found = find(sessions, session);
  check_idle(found, idle_s);
  close_one(server, found);
}

void close_domain(Operator& server, const std::string& domain, double idle_s) {
  std::vector<wire::SessionInfo> sessions = server.sessions();
  std::erase_if(sessions, [&](const wire::SessionInfo& session) { return session.domain != domain; });
  if (sessions.empty()) throw std::runtime_error(fmt::format("no open session is in domain \"{}\"", domain));
  for (const wire::SessionInfo& session : sessions) check_idle(session, idle_s);
  for (const wire::SessionInfo& session : sessions) close_one(server, session);
}

void checkpoint(Operator& server) {
  const wire::Checkpointed written = server.checkpoint();
  fmt::print("checkpoint of {:.1f} MB in {:.3f} s\n", static_cast<double>(written.bytes) / (1 << 20),
             seconds(written.duration_ns));
}

void drain(Operator& server, bool exit, std::uint64_t within_s) {
  const wire::Draining draining = server.drain(exit, within_s);
  fmt::print("no new sessions; open now: {}{}{}\n", draining.sessions,
             exit ? ", and the server ends with the last" : "",
             within_s != 0 ? fmt::format(" or in {} s", within_s) : "");
}

}  // namespace shearbus::ctl
