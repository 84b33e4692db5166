// Printed by proto/print_contract.py from shearbus/v1/*.proto, which explain the fields: requests and replies as
// values. codec.hpp turns them into frames and back; batch.hpp holds their columns. clang-format does not see this file.
// clang-format off
#pragma once

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "proto/wire/batch.hpp"
#include "proto/wire/columns.hpp"
#include "proto/wire/enums.hpp"
#include "proto/wire/field_rows.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::wire {

using SessionId = Id;
using ResumeToken = Id;
using TransferId = Id;
static_assert(sizeof(Id) == kSessionIdBytes);

struct Downscale {
  static constexpr BodyRow kBody = {18, "downscale", true};
  double dt_s = 0.0;
  double time_s = 0.0;
  std::uint64_t step = 0;
  std::uint32_t attempt = 0;
  Mode mode = Mode::kAdvance;
  bool commit_previous = false;
  std::vector<Field> wanted;
  Policy policy = Policy::kUnspecified;
  std::uint32_t part = 0;
  std::uint32_t parts = 0;
  AbsentNodes absent_nodes = AbsentNodes::kKeep;
  std::uint64_t follows = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "dt_s", m.dt_s);
    v(2, "time_s", m.time_s);
    v(3, "step", m.step);
    v(4, "attempt", m.attempt);
    v(5, "mode", required(m.mode));
    v(6, "commit_previous", m.commit_previous);
    v(7, "wanted", at_most(32, m.wanted));
    v(8, "policy", m.policy);
    v(9, "part", m.part);
    v(10, "parts", m.parts);
    v(11, "absent_nodes", m.absent_nodes);
    v(12, "follows", fixed(m.follows));
  }
};

struct Upscale {
  static constexpr BodyRow kBody = {18, "upscale", true};
  std::uint64_t nodes = 0;
  std::uint64_t state_version = 0;
  std::uint64_t solver_ns = 0;
  std::uint64_t service_ns = 0;
  std::uint64_t flagged_nodes = 0;
  double largest_closure_m_per_s = 0.0;
  std::uint64_t closure_node = 0;
  double layer_time_s = 0.0;
  std::vector<std::string> warnings;

  static void fields(auto&& v, auto& m) {
    v(1, "nodes", m.nodes);
    v(2, "state_version", m.state_version);
    v(3, "solver_ns", m.solver_ns);
    v(4, "service_ns", m.service_ns);
    v(5, "flagged_nodes", m.flagged_nodes);
    v(6, "largest_closure_m_per_s", m.largest_closure_m_per_s);
    v(7, "closure_node", m.closure_node);
    v(8, "layer_time_s", m.layer_time_s);
    v(9, "warnings", m.warnings);
  }
};

struct Hello {
  static constexpr BodyRow kBody = {16, "hello"};
  std::uint32_t oldest_major = kProtocolMajor;
  std::uint32_t newest_major = kProtocolMajor;
  std::string client_name;

  static void fields(auto&& v, auto& m) {
    v(1, "oldest_major", m.oldest_major);
    v(2, "newest_major", m.newest_major);
    v(3, "client_name", m.client_name);
  }
};

struct Limits {
  std::uint64_t max_header_bytes = kMaxHeaderBytes;
  std::uint64_t max_payload_bytes = kMaxPayloadBytes;
  std::uint64_t max_nodes_per_session = kMaxNodesPerSession;
  std::uint64_t max_sessions = kMaxSessions;
  std::uint64_t max_marks = kMaxMarks;
  std::uint64_t max_frames = kMaxFrames;
  std::uint64_t max_state_bytes = 0;
  std::uint64_t max_work_budget = 0;
  std::uint64_t max_replay_work = 0;
  std::uint64_t max_rows_per_message = kMaxRowsPerMessage;
  std::uint64_t max_sessions_per_user = kMaxSessions;
  std::uint64_t max_state_bytes_per_user = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "max_header_bytes", m.max_header_bytes);
    v(2, "max_payload_bytes", m.max_payload_bytes);
    v(3, "max_nodes_per_session", m.max_nodes_per_session);
    v(4, "max_sessions", m.max_sessions);
    v(5, "max_marks", m.max_marks);
    v(20, "max_frames", m.max_frames);
    v(21, "max_state_bytes", m.max_state_bytes);
    v(22, "max_work_budget", m.max_work_budget);
    v(23, "max_replay_work", m.max_replay_work);
    v(30, "max_rows_per_message", m.max_rows_per_message);
    v(31, "max_sessions_per_user", m.max_sessions_per_user);
    v(32, "max_state_bytes_per_user", m.max_state_bytes_per_user);
  }
};

struct Welcome {
  static constexpr BodyRow kBody = {16, "welcome"};
  std::uint32_t protocol_major = kProtocolMajor;
  std::uint32_t protocol_minor = kProtocolMinor;
  std::string server_version;
  Limits limits;
  std::vector<std::string> capabilities;
  std::string durability = "none";
  std::string access;

  static void fields(auto&& v, auto& m) {
    v(1, "protocol_major", m.protocol_major);
    v(2, "protocol_minor", m.protocol_minor);
    v(3, "server_version", m.server_version);
    v(4, "limits", m.limits);
    v(5, "capabilities", m.capabilities);
    v(6, "durability", m.durability);
    v(20, "access", m.access);
  }
};

struct OpenSession {
  static constexpr BodyRow kBody = {17, "open_session", true};
  std::string scene;
  std::string scene_file;
  SessionId session_id{};
  ResumeToken resume_token{};
  std::string domain;
  bool check_closure = false;
  std::uint64_t idle_limit_s = 0;
  std::vector<std::string> pairs;
  std::vector<std::string> parameters;

  static void fields(auto&& v, auto& m) {
    v(1, "scene", scene_text(m.scene));
    v(2, "session_id", m.session_id);
    v(3, "resume_token", m.resume_token);
    v(4, "domain", m.domain);
    v(5, "scene_file", m.scene_file);
    v(6, "check_closure", m.check_closure);
    v(7, "idle_limit_s", m.idle_limit_s);
    v(8, "pairs", at_most(257, m.pairs));
    v(9, "parameters", at_most(24, m.parameters));
  }
};

struct SessionOpened {
  static constexpr BodyRow kBody = {17, "session_opened"};
  std::string effective_scene;
  std::uint64_t bytes_per_node = 0;
  std::vector<std::string> warnings;
  Strategy strategy = Strategy::kUnspecified;
  std::uint32_t tangential_components = 1;
  std::vector<Field> required_columns;
  std::vector<Field> optional_columns;
  std::vector<Field> reply_columns;
  std::vector<Field> columns_on_request;
  std::string scene_name;
  std::vector<std::string> pairs;
  std::vector<std::string> parameters;

  static void fields(auto&& v, auto& m) {
    v(1, "effective_scene", scene_text(m.effective_scene));
    v(2, "bytes_per_node", m.bytes_per_node);
    v(3, "warnings", m.warnings);
    v(4, "strategy", m.strategy);
    v(5, "tangential_components", m.tangential_components);
    v(6, "required_columns", known_only(m.required_columns));
    v(7, "optional_columns", known_only(m.optional_columns));
    v(8, "reply_columns", known_only(m.reply_columns));
    v(9, "columns_on_request", known_only(m.columns_on_request));
    v(10, "scene_name", m.scene_name);
    v(11, "pairs", m.pairs);
    v(12, "parameters", m.parameters);
  }
};

struct ResumeSession {
  static constexpr BodyRow kBody = {23, "resume_session"};
  ResumeToken resume_token{};
  std::uint64_t claim = 0;
  std::uint64_t claimant = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "resume_token", m.resume_token);
    v(2, "claim", m.claim);
    v(3, "claimant", fixed(m.claimant));
  }
};

struct SessionResumed {
  static constexpr BodyRow kBody = {23, "session_resumed", true};
  SessionOpened session;
  std::uint64_t last_sequence = 0;
  std::uint64_t state_version = 0;
  bool trial_stands = false;
  std::uint64_t claim = 0;
  std::vector<TransferId> offers;
  std::uint64_t claimant = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "session", required(m.session));
    v(2, "last_sequence", m.last_sequence);
    v(3, "state_version", m.state_version);
    v(4, "trial_stands", m.trial_stands);
    v(5, "claim", m.claim);
    v(6, "offers", at_most(256, m.offers));
    v(7, "claimant", fixed(m.claimant));
  }
};

struct Commit {
  static constexpr BodyRow kBody = {19, "commit"};
  static void fields(auto&&, auto&) {}
};

struct Committed {
  static constexpr BodyRow kBody = {19, "committed"};
  std::uint64_t state_version = 0;

  static void fields(auto&& v, auto& m) { v(1, "state_version", m.state_version); }
};

struct Rollback {
  static constexpr BodyRow kBody = {20, "rollback"};
  std::string to_mark;

  static void fields(auto&& v, auto& m) { v(1, "to_mark", m.to_mark); }
};

struct RolledBack {
  static constexpr BodyRow kBody = {20, "rolled_back", true};
  std::uint64_t state_version = 0;

  static void fields(auto&& v, auto& m) { v(1, "state_version", m.state_version); }
};

struct Mark {
  static constexpr BodyRow kBody = {24, "mark"};
  std::string name;

  static void fields(auto&& v, auto& m) { v(1, "name", m.name); }
};

struct Marked {
  static constexpr BodyRow kBody = {24, "marked"};
  std::uint64_t state_version = 0;
  std::vector<std::string> names;

  static void fields(auto&& v, auto& m) {
    v(1, "state_version", m.state_version);
    v(2, "names", m.names);
  }
};

struct RegisterNodes {
  static constexpr BodyRow kBody = {25, "register_nodes", true};
  std::vector<std::string> pairs;

  static void fields(auto&& v, auto& m) { v(1, "pairs", at_most(257, m.pairs)); }
};

struct RetireNodes {
  static constexpr BodyRow kBody = {26, "retire_nodes", true};
  static void fields(auto&&, auto&) {}
};

struct OfferNodes {
  static constexpr BodyRow kBody = {27, "offer_nodes", true};
  TransferId transfer_id{};

  static void fields(auto&& v, auto& m) { v(1, "transfer_id", m.transfer_id); }
};

struct AcceptNodes {
  static constexpr BodyRow kBody = {28, "accept_nodes"};
  TransferId transfer_id{};

  static void fields(auto&& v, auto& m) { v(1, "transfer_id", m.transfer_id); }
};

struct NodesChanged {
  static constexpr BodyRow kBody = {25, "nodes_changed", true};
  std::uint64_t nodes = 0;

  static void fields(auto&& v, auto& m) { v(1, "nodes", m.nodes); }
};

struct ReadProfiles {
  static constexpr BodyRow kBody = {32, "read_profiles", true};
  static void fields(auto&&, auto&) {}
};

struct Profiles {
  static constexpr BodyRow kBody = {32, "profiles", true};
  std::uint64_t nodes = 0;
  std::uint64_t vertices = 0;
  std::uint64_t state_version = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "nodes", m.nodes);
    v(2, "vertices", m.vertices);
    v(3, "state_version", m.state_version);
  }
};

struct CloseSession {
  static constexpr BodyRow kBody = {21, "close_session"};
  std::string reason;

  static void fields(auto&& v, auto& m) { v(1, "reason", m.reason); }
};

struct SessionClosed {
  static constexpr BodyRow kBody = {21, "session_closed"};
  std::uint64_t requests = 0;
  std::uint64_t node_steps = 0;
  std::uint64_t solver_ns = 0;
  std::uint64_t asleep_node_steps = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "requests", m.requests);
    v(2, "node_steps", m.node_steps);
    v(3, "solver_ns", m.solver_ns);
    v(6, "asleep_node_steps", m.asleep_node_steps);
  }
};

struct ServerStatusQuery {
  static constexpr BodyRow kBody = {22, "server_status"};
  static void fields(auto&&, auto&) {}
};

struct Histogram {
  std::string name;
  std::string verb;
  std::vector<std::uint64_t> counts;
  std::uint64_t sum_ns = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "name", m.name);
    v(2, "verb", m.verb);
    v(3, "counts", m.counts);
    v(4, "sum_ns", m.sum_ns);
  }
};

struct Refusals {
  std::uint32_t code = 0;
  std::uint64_t count = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "code", m.code);
    v(2, "count", m.count);
  }
};

struct ServerStatus {
  static constexpr BodyRow kBody = {22, "server_status"};
  std::uint64_t sessions = 0;
  std::uint64_t nodes = 0;
  std::uint64_t requests = 0;
  std::uint64_t refused = 0;
  std::uint64_t replayed = 0;
  std::uint64_t node_steps = 0;
  std::uint64_t solver_ns = 0;
  std::uint64_t state_bytes = 0;
  std::uint64_t uptime_ns = 0;
  std::uint32_t threads = 0;
  std::string server_version;
  std::vector<Histogram> histograms;
  std::vector<Refusals> refusals;
  std::uint64_t journal_records = 0;
  std::uint64_t journal_bytes = 0;
  std::uint64_t recovered_requests = 0;
  std::uint64_t checkpoints = 0;
  std::uint64_t checkpoints_failed = 0;
  std::uint64_t checkpoint_bytes = 0;
  std::uint64_t checkpoint_age_ns = 0;
  std::uint64_t messages_received = 0;
  std::uint64_t messages_sent = 0;
  std::uint64_t answers_undeliverable = 0;
  std::uint64_t messages_without_user = 0;
  std::uint64_t connections_admitted = 0;
  std::uint64_t connections_refused = 0;
  bool admitting = false;
  bool draining = false;
  std::uint64_t resident_bytes = 0;
  std::uint64_t open_files = 0;
  std::uint64_t max_open_files = 0;
  std::vector<std::uint64_t> regimes;
  std::uint64_t longest_turn_ns = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "sessions", m.sessions);
    v(2, "nodes", m.nodes);
    v(3, "requests", m.requests);
    v(4, "refused", m.refused);
    v(5, "replayed", m.replayed);
    v(6, "node_steps", m.node_steps);
    v(7, "solver_ns", m.solver_ns);
    v(8, "state_bytes", m.state_bytes);
    v(9, "uptime_ns", m.uptime_ns);
    v(10, "threads", m.threads);
    v(11, "server_version", m.server_version);
    v(20, "histograms", m.histograms);
    v(21, "refusals", m.refusals);
    v(22, "journal_records", m.journal_records);
    v(23, "journal_bytes", m.journal_bytes);
    v(24, "recovered_requests", m.recovered_requests);
    v(25, "checkpoints", m.checkpoints);
    v(26, "checkpoints_failed", m.checkpoints_failed);
    v(27, "checkpoint_bytes", m.checkpoint_bytes);
    v(28, "checkpoint_age_ns", m.checkpoint_age_ns);
    v(29, "messages_received", m.messages_received);
    v(30, "messages_sent", m.messages_sent);
    v(31, "answers_undeliverable", m.answers_undeliverable);
    v(32, "messages_without_user", m.messages_without_user);
    v(33, "connections_admitted", m.connections_admitted);
    v(34, "connections_refused", m.connections_refused);
    v(35, "admitting", m.admitting);
    v(36, "draining", m.draining);
    v(37, "resident_bytes", m.resident_bytes);
    v(38, "open_files", m.open_files);
    v(39, "max_open_files", m.max_open_files);
    v(40, "regimes", m.regimes);
    v(41, "longest_turn_ns", m.longest_turn_ns);
  }
};

struct Checkpoint {
  static constexpr BodyRow kBody = {29, "checkpoint"};
  static void fields(auto&&, auto&) {}
};

struct Checkpointed {
  static constexpr BodyRow kBody = {29, "checkpointed"};
  std::uint64_t bytes = 0;
  std::uint64_t duration_ns = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "bytes", m.bytes);
    v(2, "duration_ns", m.duration_ns);
  }
};

struct Drain {
  static constexpr BodyRow kBody = {30, "drain"};
  bool exit = false;
  std::uint64_t within_s = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "exit", m.exit);
    v(2, "within_s", m.within_s);
  }
};

struct Draining {
  static constexpr BodyRow kBody = {30, "draining"};
  std::uint64_t sessions = 0;

  static void fields(auto&& v, auto& m) { v(1, "sessions", m.sessions); }
};

struct Inspect {
  static constexpr BodyRow kBody = {31, "inspect"};
  SessionId after{};
  Top top = Top::kUnspecified;
  std::uint32_t count = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "after", m.after);
    v(2, "top", m.top);
    v(3, "count", m.count);
  }
};

struct SessionInfo {
  SessionId session_id{};
  std::string name;
  std::string identity;
  std::uint64_t nodes = 0;
  std::uint64_t last_sequence = 0;
  std::uint64_t state_version = 0;
  bool trial_stands = false;
  std::uint64_t age_ns = 0;
  std::uint64_t idle_ns = 0;
  std::uint64_t state_bytes = 0;
  std::uint64_t requests = 0;
  std::uint64_t node_steps = 0;
  std::uint64_t solver_ns = 0;
  std::vector<std::uint64_t> regimes;
  std::string domain;
  std::uint64_t idle_limit_s = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "session_id", m.session_id);
    v(2, "name", m.name);
    v(3, "identity", m.identity);
    v(4, "nodes", m.nodes);
    v(5, "last_sequence", m.last_sequence);
    v(6, "state_version", m.state_version);
    v(7, "trial_stands", m.trial_stands);
    v(8, "age_ns", m.age_ns);
    v(9, "idle_ns", m.idle_ns);
    v(10, "state_bytes", m.state_bytes);
    v(11, "requests", m.requests);
    v(12, "node_steps", m.node_steps);
    v(13, "solver_ns", m.solver_ns);
    v(14, "regimes", m.regimes);
    v(15, "domain", m.domain);
    v(16, "idle_limit_s", m.idle_limit_s);
  }
};

struct Inspected {
  static constexpr BodyRow kBody = {31, "inspected", true};
  std::vector<SessionInfo> sessions;
  bool more = false;
  std::uint64_t matching = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "sessions", m.sessions);
    v(2, "more", m.more);
    v(3, "matching", m.matching);
  }
};

struct Request {
  std::uint32_t protocol_major = kProtocolMajor;
  std::uint32_t protocol_minor = kProtocolMinor;
  std::uint64_t request_id = 0;
  SessionId session_id{};
  std::uint64_t sequence = 0;
  std::uint64_t epoch = 0;
  std::variant<
    std::monostate, Hello, OpenSession, Downscale, Commit, Rollback, CloseSession, ServerStatusQuery, ResumeSession,
    Mark, RegisterNodes, RetireNodes, OfferNodes, AcceptNodes, Checkpoint, Drain, Inspect, ReadProfiles
> body;
  Batch batch;
};

struct Reply {
  std::uint32_t protocol_major = kProtocolMajor;
  std::uint32_t protocol_minor = kProtocolMinor;
  std::uint64_t request_id = 0;
  SessionId session_id{};
  std::uint64_t sequence = 0;
  std::uint64_t epoch = 0;
  Status status;
  bool replayed = false;
  std::variant<
    std::monostate, Welcome, SessionOpened, Upscale, Committed, RolledBack, SessionClosed, ServerStatus,
    SessionResumed, Marked, NodesChanged, Checkpointed, Draining, Inspected, Profiles
> body;
  Batch batch;
};

}  // namespace shearbus::wire
