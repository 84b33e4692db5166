// The C interface (client/include/shearbus/shearbus.h): the sessions of the C++ core behind functions that return
// codes. No exception leaves a function: see guarded(). c_session.cpp opens and ends sessions, c_step.cpp makes steps.
#include <algorithm>
#include <cstring>
#include <utility>

#include "client/src/c_session.hpp"
#include "proto/wire/enum_names.hpp"

using namespace shearbus;

namespace {

std::string name_of(const char* text, const char* what) {
  if (text == nullptr || *text == '\0')
    refuse(Code::kInvalidValue, fmt::format("{} is NULL or empty", what), "Give a text.", what);
  return text;
}

TransferId transfer_of(const std::uint8_t* bytes) {
  if (bytes == nullptr) refuse(Code::kInvalidValue, "transfer is NULL", "Give the 16 bytes of the offer.", "transfer");
  TransferId id;
  std::copy_n(bytes, id.size(), id.begin());
  return id;
}

}  // namespace

const char* shearbus_version(void) {
  return SHEARBUS_VERSION_TEXT;
}

const char* shearbus_code_name(int code) {
  return code == SHEARBUS_OK ? "OK" : code > 1 ? wire::name(static_cast<Code>(code)) : "?";
}

const char* shearbus_field_name(uint32_t field) {
  const wire::ColumnRow* row = wire::find_column(static_cast<Field>(field));
  return row == nullptr ? nullptr : row->name;
}

uint32_t shearbus_field_number(const char* name) {
  for (const wire::ColumnRow& row : wire::column_rows())
    if (name != nullptr && std::strcmp(row.name, name) == 0) return static_cast<std::uint32_t>(row.field);
  return 0;
}

const char* shearbus_text(const shearbus_session* session, int which) {
  if (session == nullptr || which < 0 || which > SHEARBUS_ACCESS) return "";
  return session->texts[static_cast<std::size_t>(which)].c_str();
}

int shearbus_commit(shearbus_session* session, shearbus_status* status) {
  return guarded(session, status, [&] { session_of(session).commit(); });
}

int shearbus_rollback(shearbus_session* session, shearbus_status* status) {
  return guarded(session, status, [&] { session_of(session).rollback(); });
}

int shearbus_mark(shearbus_session* session, const char* name, shearbus_status* status) {
  return guarded(session, status, [&] {
    const wire::Marked marked = session_of(session).mark(name_of(name, "name"));
    session->texts[SHEARBUS_MARK_NAMES] = lines(marked.names);
  });
}

int shearbus_rollback_to(shearbus_session* session, const char* name, shearbus_status* status) {
  return guarded(session, status, [&] { session_of(session).rollback_to(name_of(name, "name")); });
}

int shearbus_register(shearbus_session* session, size_t n, const uint64_t* node_ids,
                      const double* initial_temperature_k, shearbus_status* status) {
  const shearbus_nodes nodes = plain_nodes(n, node_ids, initial_temperature_k);
  return shearbus_register_nodes(session, &nodes, status);
}

int shearbus_register_nodes(shearbus_session* session, const shearbus_nodes* nodes, shearbus_status* status) {
  return guarded(session, status, [&] {
    const shearbus_nodes of = known(nodes, "shearbus_nodes");
    session_of(session).register_nodes(values_of(of.node_ids, of.n, "node_ids"), properties_of(of));
  });
}

int shearbus_retire(shearbus_session* session, size_t n, const uint64_t* node_ids, shearbus_status* status) {
  return guarded(session, status, [&] { session_of(session).retire_nodes(values_of(node_ids, n, "node_ids")); });
}

int shearbus_offer(shearbus_session* session, size_t n, const uint64_t* node_ids,
                   uint8_t transfer[SHEARBUS_TRANSFER_BYTES], shearbus_status* status) {
  return guarded(session, status, [&] {
    transfer_of(transfer);
    const TransferId id = session_of(session).offer_nodes(values_of(node_ids, n, "node_ids"));
    std::ranges::copy(id, transfer);
  });
}

int shearbus_accept(shearbus_session* session, const uint8_t transfer[SHEARBUS_TRANSFER_BYTES],
                    shearbus_status* status) {
  return guarded(session, status, [&] { session_of(session).accept_nodes(transfer_of(transfer)); });
}

size_t shearbus_offers(const shearbus_session* session, size_t capacity,
                       uint8_t (*transfers)[SHEARBUS_TRANSFER_BYTES]) {
  if (session == nullptr || !session->session) return 0;
  const std::vector<TransferId>& offers = session->session->offers;
  for (std::size_t i = 0; transfers != nullptr && i < std::min(capacity, offers.size()); ++i)
    std::ranges::copy(offers[i], transfers[i]);
  return offers.size();
}

size_t shearbus_node_count(const shearbus_session* session) {
  return session == nullptr || !session->session ? 0 : session->session->node_ids.size();
}

const uint64_t* shearbus_node_ids(const shearbus_session* session) {
  return shearbus_node_count(session) == 0 ? nullptr : session->session->node_ids.data();
}

const char* shearbus_effective_scene(const shearbus_session* session) {
  return session == nullptr || !session->session ? "" : session->session->opened.effective_scene.c_str();
}

const char* shearbus_warnings(const shearbus_session* session) {
  return session == nullptr ? "" : session->warnings.c_str();
}

int shearbus_inspect(const shearbus_session* session, shearbus_info* info, shearbus_status* status) {
  return guarded(session, status, [&] {
    const Session& open = session_of(session);
    known(info, "shearbus_info");
    give({.strategy = static_cast<int>(open.opened.strategy),
          .tangential_components = open.opened.tangential_components,
          .bytes_per_node = open.opened.bytes_per_node,
          .last_sequence = open.last_sequence,
          .outlives_server = session->client->welcome().durability != "none",
          .state_version = open.state_version,
          .max_rows_per_message = session->client->welcome().limits.max_rows_per_message,
          .max_marks = session->client->welcome().limits.max_marks},
         info);
  });
}

size_t shearbus_columns(const shearbus_session* session, int use, size_t capacity, uint32_t* fields) {
  if (session == nullptr || !session->session) return 0;
  const wire::SessionOpened& opened = session->session->opened;
  const std::vector<Field>* const lists[] = {&opened.required_columns, &opened.optional_columns, &opened.reply_columns,
                                             &opened.columns_on_request};
  if (use < 0 || use >= static_cast<int>(std::size(lists))) return 0;
  const std::vector<Field>& list = *lists[use];
  for (std::size_t i = 0; fields != nullptr && i < std::min(capacity, list.size()); ++i)
    fields[i] = static_cast<std::uint32_t>(list[i]);
  return list.size();
}
