#include "server/service/metrics.hpp"

namespace shearbus::service {
namespace {

// Names of the bodies' fields in the envelope, in the order of the alternatives of wire::Request::body.
constexpr std::array<const char*, Metrics::kVerbs> kVerbNames = {
    "unreadable",    "hello",         "open_session",   "downscale", "commit",         "rollback",
    "close_session", "server_status", "resume_session", "mark",      "register_nodes", "retire_nodes",
    "offer_nodes",   "accept_nodes",  "checkpoint",     "drain",     "inspect"};

}  // namespace

void Metrics::put_into(wire::ServerStatus& status) const {
  for (std::size_t verb = 0; verb < kVerbs; ++verb)
    if (!requests[verb].empty()) status.histograms.push_back(requests[verb].on_wire("request", kVerbNames[verb]));
  status.histograms.push_back(solver.on_wire("solver"));
  if (!journal_append.empty()) status.histograms.push_back(journal_append.on_wire("journal_append"));
  if (!journal_sync.empty()) status.histograms.push_back(journal_sync.on_wire("journal_sync"));
  if (!checkpoint.empty()) status.histograms.push_back(checkpoint.on_wire("checkpoint"));
  for (std::size_t code = 0; code < kCodes; ++code)
    if (refusals[code] != 0)
      status.refusals.push_back({.code = static_cast<std::uint32_t>(code), .count = refusals[code]});
}

}  // namespace shearbus::service
