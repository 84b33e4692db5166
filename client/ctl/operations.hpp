// Commands of shearbus-ctl for a running server: each sends a request and prints the answer.
#pragma once

#include <cstdint>
#include <string>

#include "client/src/client.hpp"

namespace shearbus::ctl {

void show_ping(const Client& client, const std::string& endpoint, double answered_ms);
void show_status(const wire::ServerStatus& status, bool json);
void show_sessions(Client& client, bool json);
// `session`: the first digits of a session id, or the name of its scene; may be empty if there is only one session.
void show_top(Client& client, const std::string& session, wire::Top by, std::uint32_t count);
// Closes the session with this start of its id, or this scene name, if it has been idle for `idle_s` seconds or more.
void close(Client& client, const std::string& session, double idle_s);
// Closes all sessions of a domain, or none of them if one of them has not been idle for `idle_s`.
void close_domain(Client& client, const std::string& domain, double idle_s);
void checkpoint(Client& client);
void drain(Client& client, bool exit);

// Returns the status in Prometheus' text format, version 0.0.4.
std::string prometheus_text(const wire::ServerStatus& status);

}  // namespace shearbus::ctl
