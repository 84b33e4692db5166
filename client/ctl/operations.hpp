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

// Fields of an answer by their names. NAME_s that the answer has as NAME_ns is a time, converted to seconds.
Json fields_of(const Json& answer, const std::vector<std::string>& names);

// Returns the time in seconds below which at least the fraction `share` of the counts of a histogram lies: the upper
// bound of a bucket. Nothing without counts.
std::optional<double> quantile(std::span<const std::uint64_t> counts, double share);
// A time as text in the unit that fits: "25 us", "3 min"; "-" if there is none.
std::string duration(const std::optional<double>& seconds);

// Numbers of nodes by the name of their regime, in the order of the regimes; empty if the server does not tell them.
std::vector<std::pair<std::string, std::uint64_t>> regimes_of(const Json& status);

void show_ping(const Operator& server, const std::string& endpoint, double answered_ms);

// What a server tells. A user who is no operator is told nothing about other users, the journal and the process: the
// fields of `status`, a ServerStatus, about these are zero.
struct Told {
  Json status;
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
// The SessionInfo of all open sessions.
Json sessions_of(Operator& server);
// The nodes of a session that rank highest: its `session`, how many nodes are `matching`, and the columns of `count` of
// them by their names on the wire, without any where no node qualifies.
Json top_nodes(Operator& server, const Json& session, wire::Top by, std::uint32_t count);
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
