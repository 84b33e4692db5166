// The questions of operators in the C interface, answered as JSON.
#include <fmt/format.h>

#include <memory>
#include <utility>

#include "client/src/c_calls.hpp"
#include "client/src/c_options.hpp"
#include "client/src/client.hpp"
#include "client/src/embedded_server.hpp"
#include "client/src/json_rows.hpp"
#include "client/src/session.hpp"

using namespace shearbus;

struct shearbus_operator {
  LineLog log;
  std::optional<EmbeddedServer> embedded;
  std::optional<Client> client;
  Holder holder;
  std::string answer;
};

namespace {

wire::SessionId session_of(const shearbus_question& question) {
  wire::SessionId id{};
  if (!from_hex(text_or(question.session), id))
    refuse(Code::kInvalidValue,
           fmt::format("session is \"{}\", expected 32 hexadecimal digits", in_message(text_or(question.session))),
           "Take the session_id of SHEARBUS_ASK_SESSIONS.", "session");
  return id;
}

// The columns of an answer, by their names on the wire.
void add_columns(std::string& json, const Batch& batch) {
  for (const wire::Column& column : batch.columns()) {
    if (column.count == 0) continue;
    json += fmt::format(", \"{}\": ", wire::name(column.field));
    if (column.element == wire::Element::kUint64)
      JsonRows::add_list(json, batch.u64(column.field));
    else if (column.element == wire::Element::kUint8)
      JsonRows::add_list(json, batch.u8(column.field));
    else
      JsonRows::add_list(json, batch.f64(column.field));
  }
}

std::string answer_to(const shearbus_question& question, Client& client) {
  switch (question.what) {
    case SHEARBUS_ASK_WELCOME:
      return JsonRows::of(client.welcome());
    case SHEARBUS_ASK_STATUS:
      return JsonRows::of(client.server_status());
    case SHEARBUS_ASK_SESSIONS:
      return JsonRows::of(wire::Inspected{.sessions = client.sessions()});
    case SHEARBUS_ASK_TOP: {
      Received top = client.top_nodes(session_of(question), static_cast<wire::Top>(question.top), question.count);
      auto& answer = body_of<wire::Inspected>(top);
      answer.sessions.resize(1);
      std::string json =
          fmt::format("{{\"session\": {}, \"matching\": {}", JsonRows::of(answer.sessions.front()), answer.matching);
      add_columns(json, std::as_const(top.reply.batch));
      return json + "}";
    }
    case SHEARBUS_ASK_CLOSE:
      return JsonRows::of(client.close({.session_id = session_of(question), .last_sequence = question.last_sequence}));
    case SHEARBUS_ASK_CHECKPOINT:
      return JsonRows::of(client.checkpoint());
    case SHEARBUS_ASK_DRAIN:
      return JsonRows::of(client.drain(question.exit != 0, question.within_s));
    default:
      refuse(Code::kInvalidValue,
             fmt::format("what is {}, expected SHEARBUS_ASK_WELCOME (0) to SHEARBUS_ASK_DRAIN ({})", question.what,
                         SHEARBUS_ASK_DRAIN),
             "Set the question.", "what");
  }
}

}  // namespace

int shearbus_connect(shearbus_operator** at, const shearbus_options* options, shearbus_status* status) {
  return guarded(status, [&] {
    if (at == nullptr) refuse(Code::kInvalidValue, "the address of the operator is NULL", "Give &operator.");
    if (*at != nullptr) refuse(Code::kInvalidValue, "this operator is connected already", "Use another one.");
    const shearbus_options given = known(options, "shearbus_options");
    auto made = std::make_unique<shearbus_operator>();
    made->log = LineLog(given.log, given.log_user, environment(given, "SHEARBUS_LOG"));
    const std::string endpoint = endpoint_of(given);
    try {
      embed(given, endpoint, made->embedded);
      ClientOptions to = client_options(given, endpoint, made->embedded, made->log);
      to.wait_for_recovery = false;
      made->client.emplace(std::move(to));
    } catch (const Error& fault) {
      throw naming_variable(fault.status(), options);
    }
    *at = made.release();
  });
}

int shearbus_ask(shearbus_operator* of, const shearbus_question* question, const char** answer,
                 shearbus_status* status) {
  return guarded(status, [&] {
    if (of == nullptr || answer == nullptr)
      refuse(Code::kInvalidValue, of == nullptr ? "there is no operator" : "answer is NULL",
             "Connect first; give &answer.");
    const Call call(&of->holder);
    of->answer = answer_to(known(question, "shearbus_question"), *of->client);
    *answer = of->answer.c_str();
  });
}

void shearbus_disconnect(shearbus_operator** at) {
  guarded(nullptr, [&] {
    if (at == nullptr || *at == nullptr) return;
    shearbus_operator* const of = std::exchange(*at, nullptr);
    if (of->holder.is_of_this_process()) delete of;  // in a fork the handle is forgotten: its sockets are the parent's
  });
}

int shearbus_make_keys(char public_key[SHEARBUS_KEY_BYTES], char secret_key[SHEARBUS_KEY_BYTES],
                       shearbus_status* status) {
  return guarded(status, [&] {
    if (public_key == nullptr || secret_key == nullptr)
      refuse(Code::kInvalidValue, "a key is NULL", "Give SHEARBUS_KEY_BYTES bytes for each.");
    const KeyPair pair = make_key_pair();
    public_key[pair.public_key.copy(public_key, SHEARBUS_KEY_BYTES - 1)] = '\0';
    secret_key[pair.secret_key.copy(secret_key, SHEARBUS_KEY_BYTES - 1)] = '\0';
  });
}
