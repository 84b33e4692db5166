// Commands of shearbus-ctl for a running server: each sends a request and prints the answer.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/ctl/operator.hpp"

namespace shearbus::ctl {

// The quotient is the double nearest to the exact decimal fraction, and is therefore printed as this fraction.
inline double seconds(std::uint64_t ns) {
  return static_cast<double>(ns) / 1e9;
}

// Returns the time in seconds below which at least the fraction `share` of the counts of a histogram lies: the upper
// bound of a bucket. Nothing without counts.
std::optional<double> quantile(std::span<const std::uint64_t> counts, double share);
// A time as text in the unit that fits: "25 us", "3 min"; "-" if there is none.
std::string duration(const std::optional<double>& seconds);

// Numbers of nodes by the name of their regime, in the order of the regimes; empty if the server does not tell them.
std::vector<std::pair<std::string, std::uint64_t>> regimes_of(const wire::ServerStatus& status);

void show_ping(const Operator& server, const std::string& endpoint, double answered_ms);

// What a server tells. A user who is no operator is told nothing about other users, the journal and the process: the
// fields of `status` about these are zero.
struct Told {
  wire::ServerStatus status;
  bool is_operator = false;
  bool is_durable = false;
};
Told told_by(Operator& server);
void show_status(const Told& told, bool json);
// Returns the status of the server at an endpoint. Throws Error if the server does not answer.
using StatusOf = std::function<Told(const std::string& endpoint)>;

using ServerList = std::vector<std::pair<std::string, std::string>>;  // names and endpoints of servers
// Returns the servers of a directory of endpoint files, by file name. Throws std::runtime_error if there are none.
ServerList servers_of(const std::filesystem::path& directory);
// Prints a line for each endpoint file of a directory: what the server holds, or why it does not answer. Returns false
// if one does not answer. All are asked at once, each on a thread.
bool show_all(const std::filesystem::path& directory, bool json, const StatusOf& status_of);
void show_sessions(Operator& server, bool json);
// `session`: the first digits of a session id, or the name of its scene; may be empty if there is only one session.
void show_top(Operator& server, const std::string& session, wire::Top by, std::uint32_t count);
// Closes the session with this start of its id, or this scene name, if it has been idle for `idle_s` seconds or more.
void close(Operator& server, const std::string& session, double idle_s);
// Closes all sessions of a domain, or none of them if one of them has not been idle for `idle_s`.
void close_domain(Operator& server, const std::string& domain, double idle_s);
void checkpoint(Operator& server);
void drain(Operator& server, bool exit, std::uint64_t within_s);

// Returns the status in Prometheus' text format, version 0.0.4.
std::string prometheus_text(const Told& told);
// Serves the metrics of several servers by HTTP until SIGTERM or SIGINT. At each scrape `servers` lists their names and
// endpoints, and `status_of` is called for each, by several threads at once. A server that does not answer has
// shearbus_up 0. Throws std::runtime_error if the address cannot be used.
void serve_metrics(const std::string& address, std::function<ServerList()> servers, StatusOf status_of);

}  // namespace shearbus::ctl
