#include "client/src/c_session.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <new>
#include <system_error>
#include <utility>

#include "proto/wire/text.hpp"

using namespace shearbus;

namespace {

// Takes the handle from the caller for good; null if there is none. A handle of another process is forgotten, not freed:
// its sockets and threads are that process's. A handle in use is kept, because the other thread needs it. Throws Error
// for both.
std::unique_ptr<shearbus_session> taken(shearbus_session** session) {
  if (session == nullptr || *session == nullptr) return nullptr;
  shearbus_session* const handle = *session;
  if (!handle->holder.is_of_this_process()) *session = nullptr;
  Call call(&handle->holder);
  *session = nullptr;
  call.forget();
  return std::unique_ptr<shearbus_session>(handle);
}

// A ticket that was read from a file may have the file's line end, and one of Fortran blanks.
Session::Ticket ticket_of(std::string_view text) {
  text = text.substr(0, text.find_last_not_of(" \t\r\n\v\f") + 1);
  constexpr std::size_t kDigits = 2 * wire::kSessionIdBytes;
  Session::Ticket ticket;
  if (text.size() != 2 * kDigits + 1 || text[kDigits] != ':' || !from_hex(text.substr(0, kDigits), ticket.session_id) ||
      !from_hex(text.substr(kDigits + 1), ticket.resume_token))
    refuse(Code::kInvalidValue,
           fmt::format("the ticket is no ticket: {} characters, expected {} of which 64 are hexadecimal digits",
                       text.size(), 2 * kDigits + 1),
           "Give the ticket of the session unchanged.", "ticket");
  return ticket;
}

// A server in this process would make the directory, in which no session is.
void refuse_absent_state_dir(const shearbus_options& options) {
  std::error_code ignored;
  if (options.state_dir == nullptr || !is_embedded(endpoint_of(options)) ||
      std::filesystem::exists(options.state_dir, ignored))
    return;
  refuse(Code::kUnreachable,
         fmt::format("state_dir {} is not there: it holds no session", in_message(options.state_dir)),
         "Give the directory with which the session was opened.", "state_dir");
}

SessionTexts texts_of(const Client& client, const Session& session) {
  const wire::Welcome& welcome = client.welcome();
  SessionTexts texts;
  texts[SHEARBUS_SCENE_NAME] = session.opened.scene_name;
  texts[SHEARBUS_PAIR_NAMES] = lines(session.opened.pairs);
  texts[SHEARBUS_PARAMETER_KEYS] = lines(session.opened.parameters);
  texts[SHEARBUS_SERVER_VERSION] = welcome.server_version;
  texts[SHEARBUS_CAPABILITIES] = lines(welcome.capabilities);
  texts[SHEARBUS_DURABILITY] = welcome.durability;
  texts[SHEARBUS_ACCESS] = welcome.access;
  return texts;
}

ResumedNames names_of(const Session& session) {
  ResumedNames names;
  const ResumedNodes& resumed = session.resumed;
  if (resumed.pair.empty()) return names;
  names.pairs.push_back("");
  for (const std::string& pair : session.opened.pairs) names.pairs.push_back(pair.c_str());
  for (const std::string& key : session.opened.parameters) names.parameters.push_back(key.c_str());
  for (const std::vector<double>& values : resumed.parameters) names.values.push_back(values.data());
  return names;
}

// Makes the handle of a session, in use by this call, or reuses the handle whose opening has an unknown outcome.
shearbus_session& handle_for(shearbus_session** at, const shearbus_options& options, Call& call) {
  if (*at != nullptr && (*at)->session)
    refuse(Code::kInvalidValue, "this session is open already", "Close it first, or use another handle.");
  if (*at == nullptr) {
    auto made = std::make_unique<shearbus_session>(options);
    call.enter(&made->holder);
    *at = made.release();
  }
  return **at;
}

// Opens or resumes a session by opening(options, call), which gives the handle its session. A handle that got none is freed
// unless the server may have opened the session although the call failed, and `keeps_doubted`: then the same call makes
// the same request.
template <typename Opening>
int open_by(shearbus_session** session, const shearbus_options* options, shearbus_status* status, bool keeps_doubted,
            const Opening& opening) noexcept {
  return guarded(status, [&] {
    if (session == nullptr) refuse(Code::kInvalidValue, "the address of the session is NULL", "Give &session.");
    Call call(*session == nullptr ? nullptr : &(*session)->holder);
    const auto drop_unopened = [&] {
      if (*session == nullptr || (*session)->session) return;
      call.forget();
      delete std::exchange(*session, nullptr);
    };
    try {
      opening(known(options, "shearbus_options"), call);
    } catch (const Error& fault) {
      if (!keeps_doubted || fault.status().code != Code::kUnknownOutcome) drop_unopened();
      throw naming_variable(fault.status(), options);
    } catch (const std::bad_alloc&) {
      if (!keeps_doubted) drop_unopened();
      throw;
    } catch (...) {
      drop_unopened();
      throw;
    }
  });
}

}  // namespace

// ---- the handle ----

shearbus_session::shearbus_session(const shearbus_options& options)
    : log(options.log, options.log_user, environment(options, "SHEARBUS_LOG")) {
  const std::string endpoint = endpoint_of(options);
  embed(options, endpoint, embedded);
  ClientOptions to = client_options(options, endpoint, embedded, log);
  reply_deadline = to.reply_deadline;
  ignores_environment = options.ignore_environment != 0;
  where = embedded ? "in this process" : "at " + endpoint;
  client.emplace(std::move(to));
}

void shearbus_session::opened(Session&& now, bool resuming) {
  try {
    SessionTexts told = texts_of(*client, now);
    ResumedNames names = names_of(now);
    std::string all = lines(now.opened.warnings);
    session.emplace(std::move(now));
    texts = std::move(told);
    resumed = std::move(names);
    warnings = std::move(all);
  } catch (...) {
    if (resuming) now.leave();
    throw;
  }
  try {
    tell_opening();
  } catch (const std::bad_alloc&) {
    // The session is open, though the lines about it are not written.
  }
}

void shearbus_session::tell_opening() const {
  if (!log.wanted()) {
    for (const std::string& warning : session->opened.warnings)
      if (!warning.starts_with(wire::kNote)) write_line({}, "warning: " + warning);
    return;
  }
  log(fmt::format("session of {} nodes, scene \"{}\", server {}", session->node_ids.size(), session->opened.scene_name,
                  where));
  for (const std::string& warning : session->opened.warnings) log(wire::labelled(warning));
}

namespace shearbus {

// Completes on the server the step that it may have got before it was gone. Throws if it is still gone.
void settle_doubt(shearbus_session& handle) {
  if (!handle.fallback || !handle.fallback->doubt()) return;
  const StepInDoubt& doubt = *handle.fallback->doubt();
  handle.session->step(doubt.batch, doubt.options);
  handle.fallback->settled();
}

void tell(const shearbus_session& handle, const std::string& line) {
  if (line.empty()) return;
  if (handle.log.wanted())
    handle.log(line);
  else
    write_line({}, line);
}

void refuse_no_session() {
  refuse(Code::kInvalidValue, "there is no session: none was opened, its opening failed, or it is closed",
         "Open a session first.");
}
void settle(shearbus_session& handle, bool started) {
  settle_doubt(handle);
  if (handle.started != started)
    refuse(Code::kInvalidValue,
           started ? "a step is finished that was not started" : "a started step has not been finished",
           started ? "Start a step first, and finish it once." : "Finish it before any other call.");
}

NodeOptions properties_of(const shearbus_nodes& nodes) {
  NodeOptions properties;
  if (nodes.initial_temperature_k != nullptr) properties.initial_temperature_k = {nodes.initial_temperature_k, nodes.n};
  for (const char* const name : values_of(nodes.pairs, nodes.n_pairs, "pairs"))
    properties.pairs.emplace_back(text_or(name));
  if (nodes.n_pairs > 0) properties.pair = values_of(nodes.pair, nodes.n, "pair");
  const auto keys = values_of(nodes.parameters, nodes.n_parameters, "parameters");
  const auto values = values_of(nodes.values, nodes.n_parameters, "values");
  for (std::size_t i = 0; i < keys.size(); ++i) {
    std::string key(text_or(keys[i]));
    properties.parameters.push_back({key, values_of(values[i], nodes.n, key.c_str())});
  }
  return properties;
}

std::string lines(std::span<const std::string> texts) {
  std::string all;
  for (const std::string& text : texts) all += text + '\n';
  return all;
}

}  // namespace shearbus

// ---- opening and ending ----

int shearbus_open(shearbus_session** session, const shearbus_options* options, size_t n, const uint64_t* node_ids,
                  const double* initial_temperature_k, shearbus_status* status) {
  const shearbus_nodes nodes = plain_nodes(n, node_ids, initial_temperature_k);
  return shearbus_open_nodes(session, options, &nodes, status);
}

int shearbus_open_nodes(shearbus_session** session, const shearbus_options* options, const shearbus_nodes* nodes,
                        shearbus_status* status) {
  return open_by(session, options, status, true, [&](const shearbus_options& given, Call& call) {
    const shearbus_nodes of = known(nodes, "shearbus_nodes");
    const Scene scene = scene_of(given);
    const auto ids = values_of(of.node_ids, of.n, "node_ids");
    const OpenOptions options_of_core = {
        .nodes = properties_of(of), .domain = std::string(text_or(given.domain)), .idle_limit_s = given.idle_limit_s};
    shearbus_session& handle = handle_for(session, given, call);
    handle.opened(handle.client->open(scene.text, scene.name, ids, options_of_core), false);
  });
}

int shearbus_resume(shearbus_session** session, const shearbus_options* options, const char* ticket,
                    shearbus_status* status) {
  const shearbus_nodes nodes = SHEARBUS_NODES_INIT;
  return shearbus_resume_nodes(session, options, ticket, &nodes, status);
}

int shearbus_resume_nodes(shearbus_session** session, const shearbus_options* options, const char* ticket,
                          const shearbus_nodes* nodes, shearbus_status* status) {
  return open_by(session, options, status, false, [&](const shearbus_options& given, Call& call) {
    const shearbus_nodes of = known(nodes, "shearbus_nodes");
    const Session::Ticket held = ticket_of(text_or(ticket));
    refuse_absent_state_dir(given);
    shearbus_session& handle = handle_for(session, given, call);
    handle.opened(handle.client->resume(
                      held, {.node_ids = values_of(of.node_ids, of.n, "node_ids"), .options = properties_of(of)}),
                  true);
  });
}

int shearbus_close(shearbus_session** session, shearbus_status* status) {
  return guarded(status, [&] {
    const std::unique_ptr<shearbus_session> handle = taken(session);
    if (!handle || !handle->session) return;
    if (handle->fallback) tell(*handle, handle->fallback->summary());
    if (std::exchange(handle->started, false)) {
      try {
        handle->session->finish();
      } catch (const Error& fault) {
        // If the step was refused, the session is closed all the same. A server that does not answer is not asked again.
        if (Fallback::is_gone(fault.status().code)) throw;
      }
    }
    handle->session->close();
  });
}

int shearbus_end(shearbus_session* session, shearbus_totals* totals, shearbus_status* status) {
  return guarded(session, status, [&] {
    Session& open = session_of(session);
    if (totals != nullptr) known(totals, "shearbus_totals");
    if (session->fallback) tell(*session, session->fallback->summary());
    const wire::SessionClosed closed = open.close();
    if (totals != nullptr)
      give({.requests = closed.requests,
            .node_steps = closed.node_steps,
            .solver_ns = closed.solver_ns,
            .asleep_node_steps = closed.asleep_node_steps},
           totals);
  });
}

void shearbus_leave(shearbus_session** session) {
  guarded(nullptr, [&] {
    const std::unique_ptr<shearbus_session> handle = taken(session);
    if (!handle) return;
    if (handle->fallback) tell(*handle, handle->fallback->summary());
    if (handle->session) handle->session->leave();
  });
}

int shearbus_ticket(const shearbus_session* session, char ticket[SHEARBUS_TICKET_BYTES], shearbus_status* status) {
  return guarded(session, status, [&] {
    if (ticket == nullptr) refuse(Code::kInvalidValue, "ticket is NULL", "Give SHEARBUS_TICKET_BYTES bytes.", "ticket");
    const Session::Ticket held = session_of(session).ticket();
    const std::string text = wire::hexadecimal(held.session_id) + ':' + wire::hexadecimal(held.resume_token);
    ticket[text.copy(ticket, SHEARBUS_TICKET_BYTES - 1)] = '\0';
  });
}

int shearbus_resumed_nodes(const shearbus_session* session, shearbus_nodes* nodes, shearbus_status* status) {
  return guarded(session, status, [&] {
    const ResumedNodes& resumed = session_of(session).resumed;
    known(nodes, "shearbus_nodes");
    const ResumedNames& names = session->resumed;
    give({.n = resumed.node_ids.size(),
          .node_ids = resumed.node_ids.data(),
          .n_pairs = names.pairs.size(),
          .pairs = names.pairs.data(),
          .pair = resumed.pair.data(),
          .n_parameters = names.parameters.size(),
          .parameters = names.parameters.data(),
          .values = names.values.data()},
         nodes);
  });
}

int shearbus_set_reply_deadline(shearbus_session* session, double reply_deadline_s, shearbus_status* status) {
  return guarded(session, status, [&] {
    if (session == nullptr) session_of(session);
    session->reply_deadline = seconds(reply_deadline_s, ClientOptions().reply_deadline, "reply_deadline_s");
    session->client->set_reply_deadline(session->reply_deadline);
  });
}
