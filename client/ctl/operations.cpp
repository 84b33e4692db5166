#include "client/ctl/operations.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <future>
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

Json json_of(const Told& told) {
  Json json = fields_of(told.status, {"server_version", "uptime_s", "threads", "sessions", "nodes", "state_bytes",
                                      "requests", "refused", "replayed", "node_steps", "solver_s", "draining"});
  json["regimes"] = Json::object();
  for (const auto& [regime, nodes] : regimes_of(told.status)) json["regimes"][regime] = nodes;
  if (told.is_operator)
    json.update(
        fields_of(told.status, {"checkpoints", "journal_bytes", "longest_turn_s", "resident_bytes", "open_files"}));
  return json;
}

double megabytes(const Json& answer, const char* field) {
  return static_cast<double>(count(answer, field)) / (1 << 20);
}

const Json& find(const Json& sessions, const std::string& wanted) {
  const Json* found = nullptr;
  for (const Json& session : sessions) {
    if (!wanted.empty() && !text(session, "session_id").starts_with(wanted) && text(session, "name") != wanted)
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
void check_idle(const Json& session, double idle_s) {
  if (seconds(session, "idle_ns") >= idle_s) return;
  throw std::runtime_error(
      fmt::format("session {} was at work {:.1f} s ago: it is closed only after {} s without a "
                  "request (--idle), for its states are lost then",
                  text(session, "session_id"), seconds(session, "idle_ns"), idle_s));
}

// A session whose texts, which are its user's, are as a terminal may have them.
Json printable(Json session) {
  for (const char* const field : {"name", "identity", "domain"})
    session[field] = wire::printable(text(session, field), wire::kMaxTextBytes);
  return session;
}

void close_one(Operator& server, const Json& session) {
  const std::string id = text(session, "session_id");
  shearbus_question question = SHEARBUS_QUESTION_INIT;
  question.what = SHEARBUS_ASK_CLOSE;
  question.session = id.c_str();
  question.last_sequence = count(session, "last_sequence");  // as sessions_of() told it
  const Json closed = server.ask(question), shown = printable(session);
  fmt::print("{} closed: \"{}\" of {}, {}, {}; its states are gone\n", id, text(shown, "name"), text(shown, "identity"),
             wire::counted(count(session, "nodes"), "node"), wire::counted(count(closed, "requests"), "request"));
}

}  // namespace

Json fields_of(const Json& answer, const std::vector<std::string>& names) {
  Json fields;
  for (const std::string& name : names)
    fields[name] = answer.contains(name) ? answer.at(name)
                                         : Json(seconds(answer, (name.substr(0, name.size() - 1) + "ns").c_str()));
  return fields;
}

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

std::vector<std::pair<std::string, std::uint64_t>> regimes_of(const Json& status) {
  std::vector<std::pair<std::string, std::uint64_t>> counts;
  const auto told = status.at("regimes").get<std::vector<std::uint64_t>>();
  for (std::size_t r = 0; r < std::min(told.size(), wire::kRegimeCount); ++r)
    counts.emplace_back(wire::regime_name(r), told[r]);
  return counts;
}

void show_ping(const Operator& server, const std::string& endpoint, double answered_ms) {
  const Json& welcome = server.welcome();
  fmt::print("{}: server {}, protocol {}.{}, knows you by {}, answered in {:.1f} ms\n", endpoint,
             text(welcome, "server_version"), count(welcome, "protocol_major"), count(welcome, "protocol_minor"),
             text(welcome, "access"), answered_ms);
}

Told told_by(Operator& server) {
  const Json& can = server.welcome().at("capabilities");
  return {.status = server.ask(SHEARBUS_ASK_STATUS),
          .is_operator = std::find(can.begin(), can.end(), "operator") != can.end(),
          .is_durable = text(server.welcome(), "durability") != "none"};
}

void show_status(const Told& told, bool json) {
  const Json& s = told.status;
  if (json) return fmt::print("{}\n", json_of(told).dump());
  const auto number = [&](const char* field) { return count(s, field); };
  show("server", fmt::format("{} ({} threads), up {:.0f} s{}", text(s, "server_version"), number("threads"),
                             seconds(s, "uptime_ns"), flag(s, "draining") ? ", draining: no new sessions" : ""));
  show("sessions",
       fmt::format("{}{} with {}, {:.1f} MB of states", number("sessions"), told.is_operator ? "" : " of yours",
                   wire::counted(number("nodes"), "node"), megabytes(s, "state_bytes")));
  std::string regimes;
  for (const auto& [regime, nodes] : regimes_of(s))
    regimes += fmt::format("{}{} {}", regimes.empty() ? "" : ", ", regime, nodes);
  if (!regimes.empty()) show("regimes", regimes);
  show("requests",
       fmt::format("{} ({} refused, {} repeated)", number("requests"), number("refused"), number("replayed")));
  for (const Json& refusals : s.at("refusals"))
    show("", fmt::format("refused {}: {}", name(static_cast<Code>(count(refusals, "code"))), count(refusals, "count")));
  const auto node_steps = static_cast<double>(number("node_steps"));
  show("node-steps",
       fmt::format("{} in {:.3f} s of solver time ({:.0f} ns each)", number("node_steps"), seconds(s, "solver_ns"),
                   node_steps == 0 ? 0.0 : static_cast<double>(number("solver_ns")) / node_steps));
  for (const Json& histogram : s.at("histograms")) {
    const std::string name = text(histogram, "name"), verb = text(histogram, "verb");
    if (verb != "downscale" && !name.starts_with("journal") && name != "checkpoint") continue;
    const auto counts = histogram.at("counts").get<std::vector<std::uint64_t>>();
    show(
        verb.empty() ? name.c_str() : verb.c_str(),
        fmt::format("half below {}, 99 % below {}", duration(quantile(counts, 0.5)), duration(quantile(counts, 0.99))));
  }
  if (!told.is_operator) return show("", "all users, journal and process: told to operators");
  show("journal", told.is_durable
                      ? fmt::format("{} requests, {:.1f} MB; {} checkpoints ({} failed)", number("journal_records"),
                                    megabytes(s, "journal_bytes"), number("checkpoints"), number("checkpoints_failed"))
                      : "none: the server was started without --state-dir");
  show("connections",
       fmt::format("{} admitted, {} refused{}", number("connections_admitted"), number("connections_refused"),
                   flag(s, "admitting") ? "" : "; NOBODY NEW IS ADMITTED: restart the server"));
  show("turns", fmt::format("one request kept the others waiting for {:.0f} ms of processor time at most",
                            1e-6 * static_cast<double>(number("longest_turn_ns"))));
  show("process", fmt::format("{:.1f} MB resident, {} of {} files open", megabytes(s, "resident_bytes"),
                              number("open_files"), number("max_open_files")));
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
      const Json& s = told.status;
      if (json) {
        Json line = {{"file", name}};
        line.update(json_of(told));
        fmt::print("{}\n", line.dump());
      } else {
        fmt::print("{:<20} {}{} with {}, {} ({} refused), up {:.0f} s{}\n", name,
                   wire::counted(count(s, "sessions"), "session"), told.is_operator ? "" : " of yours",
                   wire::counted(count(s, "nodes"), "node"), wire::counted(count(s, "requests"), "request"),
                   count(s, "refused"), seconds(s, "uptime_ns"), flag(s, "draining") ? ", draining" : "");
      }
    } catch (const Error& fault) {
      all_answer = false;
      if (json)
        fmt::print("{}\n", Json{{"file", name}, {"fault", wire::printable(fault.what(), kLongestFault)}}.dump());
      else
        fmt::print("{:<20} {}\n", name, wire::printable(fault.what(), kLongestFault));
    }
  }
  return all_answer;
}

Json sessions_of(Operator& server) {
  return server.ask(SHEARBUS_ASK_SESSIONS).at("sessions");
}

void show_sessions(Operator& server, bool json) {
  const Json sessions = sessions_of(server);
  if (!json)
    fmt::print("{:<32} {:>8} {:>8} {:>9} {:>8} {:>8}  {}\n", "session", "nodes", "version", "last seq", "age, s",
               "idle, s", "scene, opened by");
  for (const Json& session : sessions) {
    if (json) {
      Json line = {{"session", session.at("session_id")}};
      line.update(
          fields_of(session, {"name", "identity", "domain", "nodes", "state_version", "last_sequence", "trial_stands",
                              "age_s", "idle_s", "idle_limit_s", "state_bytes", "node_steps", "solver_s"}));
      fmt::print("{}\n", line.dump());
      continue;
    }
    const Json s = printable(session);
    const std::string domain = text(s, "domain");
    fmt::print("{:<32} {:>8} {:>8} {:>9} {:>8.0f} {:>8.0f}  {}, {}{}\n", text(s, "session_id"), count(s, "nodes"),
               count(s, "state_version"), count(s, "last_sequence"), seconds(s, "age_ns"), seconds(s, "idle_ns"),
               text(s, "name"), text(s, "identity"),
               (domain.empty() ? "" : ", domain " + domain) + (flag(s, "trial_stands") ? ", a trial stands" : ""));
  }
}

Json top_nodes(Operator& server, const Json& session, wire::Top by, std::uint32_t count) {
  const std::string id = text(session, "session_id");
  shearbus_question question = SHEARBUS_QUESTION_INIT;
  question.what = SHEARBUS_ASK_TOP;
  question.session = id.c_str();
  question.top = static_cast<int>(by);
  question.count = count;
  return server.ask(question);
}

void show_top(Operator& server, const std::string& session, wire::Top by, std::uint32_t most) {
  const Json top = top_nodes(server, find(sessions_of(server), session), by, most);
  const Json shown = printable(top.at("session")), ids = top.value("node_id", Json::array());
  fmt::print("{} ({}, version {}): {} of {}\n", text(shown, "name"), wire::counted(count(shown, "nodes"), "node"),
             count(shown, "state_version"), ids.size(), count(top, "matching"));
  const char* const velocity = wire::name(wire::Field::kSlidingVelocity);
  const bool sliding = top.contains(velocity);
  const auto value = [&](wire::Field column, std::size_t node) {
    return top.at(wire::name(column))[node].get<double>();
  };
  fmt::print("{:>20} {:>12} {:>14} {:>8}{}\n", "node", "T0, K", "s, MPa", "regime", sliding ? "       [v], m/s" : "");
  for (std::size_t i = 0; i < ids.size(); ++i) {
    fmt::print("{:>20} {:>12.3f} {:>14.6f} {:>8}", ids[i].get<std::uint64_t>(),
               value(wire::Field::kInterfaceTemperature, i), 1e-6 * value(wire::Field::kShearStress, i),
               wire::regime_name(top.at("regime")[i].get<std::uint64_t>()));
    if (sliding) fmt::print(" {:>14.6f}", value(wire::Field::kSlidingVelocity, i));
    fmt::print("\n");
  }
}

void close(Operator& server, const std::string& session, double idle_s) {
  const Json sessions = sessions_of(server);
  const Json& found = find(sessions, session);
  check_idle(found, idle_s);
  close_one(server, found);
}

void close_domain(Operator& server, const std::string& domain, double idle_s) {
  std::vector<Json> sessions;
  for (Json& session : sessions_of(server))
    if (wire::is_domain_of_run(text(session, "domain"), domain)) sessions.push_back(std::move(session));
  if (sessions.empty()) throw std::runtime_error(fmt::format("no open session is in domain \"{}\"", domain));
  for (const Json& session : sessions) check_idle(session, idle_s);
  for (const Json& session : sessions) close_one(server, session);
}

void checkpoint(Operator& server) {
  const Json written = server.ask(SHEARBUS_ASK_CHECKPOINT);
  fmt::print("checkpoint of {:.1f} MB in {:.3f} s\n", megabytes(written, "bytes"), seconds(written, "duration_ns"));
}

void drain(Operator& server, bool exit, std::uint64_t within_s) {
  shearbus_question question = SHEARBUS_QUESTION_INIT;
  question.what = SHEARBUS_ASK_DRAIN;
  question.exit = exit ? 1 : 0;
  question.within_s = within_s;
  fmt::print("no new sessions; open now: {}{}{}\n", count(server.ask(question), "sessions"),
             exit ? ", and the server ends with the last" : "",
             within_s != 0 ? fmt::format(" or in {} s", within_s) : "");
}

}  // namespace shearbus::ctl
