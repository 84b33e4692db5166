// Internal to the C interface: the handle of a session, and the calls on it.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "client/src/c_calls.hpp"
#include "client/src/c_options.hpp"
#include "client/src/client.hpp"
#include "client/src/embedded_server.hpp"
#include "client/src/fallback.hpp"

namespace shearbus {

using SessionTexts = std::array<std::string, SHEARBUS_ACCESS + 1>;  // by the numbers of shearbus_text()

struct ResumedNames {  // what shearbus_resumed_nodes() points to
  std::vector<const char*> pairs, parameters;
  std::vector<const double*> values;
};

}  // namespace shearbus

// The members are destroyed in reverse order: the session before its client, the client before its server.
struct shearbus_session {
  explicit shearbus_session(const shearbus_options& options);

  // Adopts a session. Where there is no memory for what it tells, it ends as it began: closed, or left on the server.
  void opened(shearbus::Session&& now, bool resuming);

  mutable shearbus::Holder holder;
  shearbus::LineLog log;
  std::optional<shearbus::EmbeddedServer> embedded;
  std::optional<shearbus::Client> client;
  std::optional<shearbus::Session> session;  // empty while the opening has an unknown outcome
  std::string where;
  std::string warnings;
  shearbus::SessionTexts texts;
  shearbus::ResumedNames resumed;
  std::uint64_t steps = 0;  // number of steps answered so far
  // The present step.
  shearbus::Batch batch;
  std::vector<shearbus::Field> batch_fields;  // columns that `batch` was made with
  std::size_t batch_rows = 0;
  std::vector<shearbus_output> outputs;
  bool started = false;  // true between shearbus_start() and shearbus_finish()
  std::chrono::milliseconds reply_deadline{0};
  std::optional<shearbus::Fallback> fallback;  // set once the host has given a law of its own
  bool ignores_environment = false;

 private:
  void tell_opening() const;
};

namespace shearbus {

// guarded() for a call on a session, which one thread of the session's process makes at a time.
template <typename Body>
int guarded(const shearbus_session* session, shearbus_status* status, const Body& body) noexcept {
  return guarded(status, [&] {
    const Call call(session == nullptr ? nullptr : &session->holder);
    body();
  });
}

// The session of a handle; refuses a handle without one. The second overload also completes a step in doubt, and refuses
// a handle with an unfinished step if `started` is false, and one without an unfinished step if it is true.
[[noreturn]] void refuse_no_session();
inline const Session& session_of(const shearbus_session* handle) {
  if (handle == nullptr || !handle->session) refuse_no_session();
  return *handle->session;
}
void settle(shearbus_session& handle, bool started);
inline Session& session_of(shearbus_session* handle, bool started = false) {
  session_of(static_cast<const shearbus_session*>(handle));
  settle(*handle, started);
  return *handle->session;
}

void tell(const shearbus_session& handle, const std::string& line);  // to the log or standard error; nothing for ""

inline shearbus_nodes plain_nodes(std::size_t n, const std::uint64_t* node_ids, const double* initial_temperature_k) {
  return {.size = sizeof(shearbus_nodes), .n = n, .node_ids = node_ids, .initial_temperature_k = initial_temperature_k};
}
// The properties of new nodes. Names of pairs, keys and arrays of parameters must be there where their number says so.
NodeOptions properties_of(const shearbus_nodes& nodes);

std::string lines(std::span<const std::string> texts);  // one after the other, each with its line end

}  // namespace shearbus
