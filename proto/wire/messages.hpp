// Requests and replies as values. codec.hpp turns them into frames and back; batch.hpp holds their columns.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "proto/wire/batch.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/columns.hpp"

namespace shearbus::wire {

using SessionId = std::array<std::uint8_t, kSessionIdBytes>;  // all zero: none

// Same numbers as shearbus.v1.Regime and Outcome, where they are explained.
enum class Regime : std::uint8_t { kOpen = 0, kStick = 1, kCoulomb = 2, kTresca = 3, kMelting = 4 };
enum Outcome : std::uint8_t {
  kOutcomeOk = 0,
  kSubstepped = 1,
  kMultipleRoots = 2,
  kOutsideDomain = 4,
  kAsleep = 32,
  kFirstOrder = 64,
  kFailed = 128,
};

enum class Mode { kUnspecified = 0, kAdvance = 1, kTrial = 2 };
enum class Policy { kUnspecified = 0, kAccept = 1, kAllOrNothing = 2 };  // kUnspecified is kAccept

struct Hello {
  std::uint32_t oldest_major = kProtocolMajor;
  std::uint32_t newest_major = kProtocolMajor;
  std::string client_name;
};
using ResumeToken = std::array<std::uint8_t, 16>;  // all zero: none
struct OpenSession {
  std::string scene;       // TOML text
  std::string scene_file;  // its name, for messages about it
  SessionId session_id{};
  ResumeToken resume_token{};
  std::string domain;  // empty: none
};
struct Downscale {
  double dt_s = 0.0;
  double time_s = 0.0;
  std::uint64_t step = 0;
  std::uint32_t attempt = 0;
  Mode mode = Mode::kAdvance;
  bool commit_previous = false;
  std::vector<Field> wanted;  // empty: all of the strategy's
  Policy policy = Policy::kUnspecified;
};
struct Commit {};
struct Rollback {
  std::string to_mark;  // empty: the standing trial is forgotten
};
struct Mark {
  std::string name;
};
struct RegisterNodes {};
struct RetireNodes {};
using TransferId = std::array<std::uint8_t, 16>;
struct OfferNodes {
  TransferId transfer_id{};
};
struct AcceptNodes {
  TransferId transfer_id{};
};
struct CloseSession {
  std::string reason;
};
struct ServerStatusQuery {};
struct Checkpoint {};
struct Drain {
  bool exit = false;
};
enum class Top { kUnspecified = 0, kHottest = 1, kFastest = 2, kMolten = 3 };
struct Inspect {
  SessionId after{};
  Top top = Top::kUnspecified;
  std::uint32_t count = 0;
};
struct ResumeSession {
  ResumeToken resume_token{};
  std::uint64_t claim = 0;
  std::uint64_t claimant = 0;
};

struct Request {
  std::uint32_t protocol_major = kProtocolMajor;
  std::uint32_t protocol_minor = kProtocolMinor;
  std::uint64_t request_id = 0;
  SessionId session_id{};
  std::uint64_t sequence = 0;
  std::uint64_t epoch = 0;
  std::variant<std::monostate, Hello, OpenSession, Downscale, Commit, Rollback, CloseSession, ServerStatusQuery,
               ResumeSession, Mark, RegisterNodes, RetireNodes, OfferNodes, AcceptNodes, Checkpoint, Drain, Inspect>
      body;
  Batch batch;
};

struct Limits {
  std::uint64_t max_header_bytes = kMaxHeaderBytes;
  std::uint64_t max_payload_bytes = kMaxPayloadBytes;
  std::uint64_t max_nodes_per_session = kMaxNodesPerSession;
  std::uint64_t max_sessions = kMaxSessions;
  std::uint64_t max_marks = kMaxMarks;
  std::uint64_t max_frames = kMaxFrames;
  std::uint64_t max_state_bytes = 0;
};
struct Welcome {
  std::uint32_t protocol_major = kProtocolMajor;
  std::uint32_t protocol_minor = kProtocolMinor;
  std::string server_version;
  Limits limits;
  std::vector<std::string> capabilities;
  std::string durability = "none";
  std::string access;
};
struct SessionOpened {
  std::string effective_scene;  // canonical TOML text
  std::uint64_t bytes_per_node = 0;
  std::vector<std::string> warnings;
  Strategy strategy = Strategy::kUnspecified;
  std::uint32_t tangential_components = 1;
  std::vector<Field> required_columns;    // of a step, besides the optional node_id
  std::vector<Field> optional_columns;    // of a step
  std::vector<Field> reply_columns;       // where the request names none
  std::vector<Field> columns_on_request;  // where the request names them
  std::string scene_name;
};
struct SessionResumed {
  SessionOpened session;
  std::uint64_t last_sequence = 0;
  std::uint64_t state_version = 0;
  bool trial_stands = false;
  std::uint64_t claim = 0;
  std::vector<std::array<std::uint8_t, 16>> offers;  // TransferId, oldest first
};
struct Upscale {
  std::uint64_t nodes = 0;
  std::uint64_t state_version = 0;
  std::uint64_t solver_ns = 0;
  std::uint64_t service_ns = 0;
  std::uint64_t flagged_nodes = 0;
};
struct Committed {
  std::uint64_t state_version = 0;
};
struct RolledBack {
  std::uint64_t state_version = 0;
};
struct Marked {
  std::uint64_t state_version = 0;
  std::vector<std::string> names;  // oldest first
};
struct NodesChanged {
  std::uint64_t nodes = 0;
};
struct SessionClosed {
  std::uint64_t requests = 0;
  std::uint64_t node_steps = 0;
  std::uint64_t solver_ns = 0;
  std::uint64_t asleep_node_steps = 0;
};
struct Histogram {
  std::string name;
  std::string verb;
  std::vector<std::uint64_t> counts;
  std::uint64_t sum_ns = 0;
};
inline constexpr std::uint64_t kHistogramBaseNs = 1024;  // counts[i] were shorter than this times 2^i
struct Refusals {
  std::uint32_t code = 0;
  std::uint64_t count = 0;
};
struct Checkpointed {
  std::uint64_t bytes = 0;
  std::uint64_t duration_ns = 0;
};
struct Draining {
  std::uint64_t sessions = 0;
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
};
struct Inspected {
  std::vector<SessionInfo> sessions;
  bool more = false;
  std::uint64_t matching = 0;
};
struct ServerStatus {
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
  std::variant<std::monostate, Welcome, SessionOpened, Upscale, Committed, RolledBack, SessionClosed, ServerStatus,
               SessionResumed, Marked, NodesChanged, Checkpointed, Draining, Inspected>
      body;
  Batch batch;
};

}  // namespace shearbus::wire
