#include "server/service/metrics.hpp"

namespace shearbus::service {
namespace {

// Names of the kinds of request, in the order of the variant wire::Request::body, which begins with the empty body.
template <typename... Body>
constexpr std::array<const char*, Metrics::kVerbs> names_of(const std::variant<std::monostate, Body...>*) {
  return {"unreadable", Body::kBody.name...};
}
constexpr auto kVerbNames = names_of(static_cast<const decltype(wire::Request::body)*>(nullptr));

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
