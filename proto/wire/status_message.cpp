#include "proto/wire/status_message.hpp"

#include <span>

#include "proto/wire/envelope_message.hpp"
#include "proto/wire/text.hpp"
#include "shearbus/v1/control.pb.h"

namespace shearbus::wire {
namespace {

std::vector<Histogram> take(const google::protobuf::RepeatedPtrField<v1::Histogram>& from) {
  std::vector<Histogram> to;
  for (const v1::Histogram& histogram : from)
    to.push_back({.name = histogram.name(),
                  .verb = histogram.verb(),
                  .counts = {histogram.counts().begin(), histogram.counts().end()},
                  .sum_ns = histogram.sum_ns()});
  return to;
}
std::vector<Refusals> take(const google::protobuf::RepeatedPtrField<v1::Refusals>& from) {
  std::vector<Refusals> to;
  for (const v1::Refusals& refusals : from) to.push_back({.code = refusals.code(), .count = refusals.count()});
  return to;
}

}  // namespace

void to_message(const ServerStatus& from, v1::ServerStatus& to) {
  to.set_sessions(from.sessions);
  to.set_nodes(from.nodes);
  to.set_requests(from.requests);
  to.set_refused(from.refused);
  to.set_replayed(from.replayed);
  to.set_node_steps(from.node_steps);
  to.set_solver_ns(from.solver_ns);
  to.set_state_bytes(from.state_bytes);
  to.set_uptime_ns(from.uptime_ns);
  to.set_threads(from.threads);
  to.set_server_version(as_utf8(from.server_version, kMaxTextBytes));
  for (const Histogram& histogram : from.histograms) {
    v1::Histogram& message = *to.add_histograms();
    message.set_name(histogram.name);
    message.set_verb(histogram.verb);
    message.mutable_counts()->Add(histogram.counts.begin(), histogram.counts.end());
    message.set_sum_ns(histogram.sum_ns);
  }
  for (const Refusals& refusals : from.refusals) {
    v1::Refusals& message = *to.add_refusals();
    message.set_code(refusals.code);
    message.set_count(refusals.count);
  }
  to.set_journal_records(from.journal_records);
  to.set_journal_bytes(from.journal_bytes);
  to.set_recovered_requests(from.recovered_requests);
  to.set_checkpoints(from.checkpoints);
  to.set_checkpoints_failed(from.checkpoints_failed);
  to.set_checkpoint_bytes(from.checkpoint_bytes);
  to.set_checkpoint_age_ns(from.checkpoint_age_ns);
  to.set_messages_received(from.messages_received);
  to.set_messages_sent(from.messages_sent);
  to.set_answers_undeliverable(from.answers_undeliverable);
  to.set_messages_without_user(from.messages_without_user);
  to.set_connections_admitted(from.connections_admitted);
  to.set_connections_refused(from.connections_refused);
  to.set_admitting(from.admitting);
  to.set_draining(from.draining);
  to.set_resident_bytes(from.resident_bytes);
  to.set_open_files(from.open_files);
  to.set_max_open_files(from.max_open_files);
}
void to_message(const Inspected& from, v1::Inspected& to) {
  to.set_more(from.more);
  to.set_matching(from.matching);
  for (const SessionInfo& session : from.sessions) {
    v1::SessionInfo& message = *to.add_sessions();
    message.set_session_id({session.session_id.begin(), session.session_id.end()});
    message.set_name(as_utf8(session.name, kMaxTextBytes));
    message.set_identity(as_utf8(session.identity, kMaxTextBytes));
    message.set_nodes(session.nodes);
    message.set_last_sequence(session.last_sequence);
    message.set_state_version(session.state_version);
    message.set_trial_stands(session.trial_stands);
    message.set_age_ns(session.age_ns);
    message.set_idle_ns(session.idle_ns);
    message.set_state_bytes(session.state_bytes);
    message.set_requests(session.requests);
    message.set_node_steps(session.node_steps);
    message.set_solver_ns(session.solver_ns);
  }
}

ServerStatus from_message(const v1::ServerStatus& from) {
  return {.sessions = from.sessions(),
          .nodes = from.nodes(),
          .requests = from.requests(),
          .refused = from.refused(),
          .replayed = from.replayed(),
          .node_steps = from.node_steps(),
          .solver_ns = from.solver_ns(),
          .state_bytes = from.state_bytes(),
          .uptime_ns = from.uptime_ns(),
          .threads = from.threads(),
          .server_version = from.server_version(),
          .histograms = take(from.histograms()),
          .refusals = take(from.refusals()),
          .journal_records = from.journal_records(),
          .journal_bytes = from.journal_bytes(),
          .recovered_requests = from.recovered_requests(),
          .checkpoints = from.checkpoints(),
          .checkpoints_failed = from.checkpoints_failed(),
          .checkpoint_bytes = from.checkpoint_bytes(),
          .checkpoint_age_ns = from.checkpoint_age_ns(),
          .messages_received = from.messages_received(),
          .messages_sent = from.messages_sent(),
          .answers_undeliverable = from.answers_undeliverable(),
          .messages_without_user = from.messages_without_user(),
          .connections_admitted = from.connections_admitted(),
          .connections_refused = from.connections_refused(),
          .admitting = from.admitting(),
          .draining = from.draining(),
          .resident_bytes = from.resident_bytes(),
          .open_files = from.open_files(),
          .max_open_files = from.max_open_files()};
}
Inspected from_message(const v1::Inspected& from) {
  Inspected to{.sessions = {}, .more = from.more(), .matching = from.matching()};
  for (const v1::SessionInfo& session : from.sessions())
    to.sessions.push_back(
        {.session_id = id_from(std::as_bytes(std::span(session.session_id())), "inspected.sessions.session_id"),
         .name = session.name(),
         .identity = session.identity(),
         .nodes = session.nodes(),
         .last_sequence = session.last_sequence(),
         .state_version = session.state_version(),
         .trial_stands = session.trial_stands(),
         .age_ns = session.age_ns(),
         .idle_ns = session.idle_ns(),
         .state_bytes = session.state_bytes(),
         .requests = session.requests(),
         .node_steps = session.node_steps(),
         .solver_ns = session.solver_ns()});
  return to;
}

}  // namespace shearbus::wire
