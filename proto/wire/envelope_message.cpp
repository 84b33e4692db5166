#include "proto/wire/envelope_message.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <type_traits>
#include <utility>

#include "proto/wire/scene_message.hpp"
#include "proto/wire/status_message.hpp"
#include "proto/wire/text.hpp"
#include "shearbus/v1/envelope.pb.h"

namespace shearbus::wire {
namespace {

// The C++ enums are the proto's, number by number.
template <typename Ours, typename Theirs>
constexpr bool same(Ours ours, Theirs theirs) {
  return static_cast<long>(ours) == static_cast<long>(theirs);
}
static_assert(
    same(Field::kNodeId, v1::FIELD_NODE_ID) && same(Field::kInitialTemperature, v1::FIELD_INITIAL_TEMPERATURE_K) &&
    same(Field::kVelocityJump, v1::FIELD_VELOCITY_JUMP_M_PER_S) && same(Field::kPressure, v1::FIELD_PRESSURE_PA) &&
    same(Field::kStressMinus, v1::FIELD_STRESS_MINUS_PA) && same(Field::kStressPlus, v1::FIELD_STRESS_PLUS_PA) &&
    same(Field::kMassMinus, v1::FIELD_MASS_MINUS_KG_PER_M2) && same(Field::kMassPlus, v1::FIELD_MASS_PLUS_KG_PER_M2) &&
    same(Field::kSoftShearRate, v1::FIELD_SOFT_SHEAR_RATE_PER_S) &&
    same(Field::kSoftPlasticStrainRate, v1::FIELD_SOFT_PLASTIC_STRAIN_RATE_PER_S) &&
    same(Field::kShearStress, v1::FIELD_SHEAR_STRESS_PA) &&
    same(Field::kSlidingVelocity, v1::FIELD_SLIDING_VELOCITY_M_PER_S) &&
    same(Field::kInterfaceTemperature, v1::FIELD_INTERFACE_TEMPERATURE_K) &&
    same(Field::kVelocityJumpNew, v1::FIELD_VELOCITY_JUMP_NEW_M_PER_S) && same(Field::kRegime, v1::FIELD_REGIME) &&
    same(Field::kOutcome, v1::FIELD_OUTCOME) && same(Field::kFrictionHeat, v1::FIELD_FRICTION_HEAT_J_PER_M2) &&
    same(Field::kInterfaceWork, v1::FIELD_INTERFACE_WORK_J_PER_M2) &&
    same(Field::kHeatToSoft, v1::FIELD_HEAT_TO_SOFT_J_PER_M2) &&
    same(Field::kHeatToHard, v1::FIELD_HEAT_TO_HARD_J_PER_M2) &&
    same(Field::kPlasticWork, v1::FIELD_PLASTIC_WORK_J_PER_M2) &&
    same(Field::kStoredHeatSoft, v1::FIELD_STORED_HEAT_SOFT_J_PER_M2) &&
    same(Field::kStoredHeatHard, v1::FIELD_STORED_HEAT_HARD_J_PER_M2) &&
    same(Field::kElasticEnergy, v1::FIELD_ELASTIC_ENERGY_J_PER_M2) &&
    same(Field::kHeatResidual, v1::FIELD_HEAT_RESIDUAL_J_PER_M2) &&
    same(Field::kEnergyResidual, v1::FIELD_ENERGY_RESIDUAL_J_PER_M2));
static_assert(same(Element::kFloat64, v1::ELEMENT_FLOAT64) && same(Element::kUint64, v1::ELEMENT_UINT64) &&
              same(Element::kUint8, v1::ELEMENT_UINT8));
static_assert(same(Mode::kAdvance, v1::MODE_ADVANCE) && same(Mode::kTrial, v1::MODE_TRIAL) &&
              same(Policy::kAccept, v1::POLICY_ACCEPT) && same(Policy::kAllOrNothing, v1::POLICY_ALL_OR_NOTHING));
static_assert(same(Regime::kOpen, v1::REGIME_OPEN) && same(Regime::kStick, v1::REGIME_STICK) &&
              same(Regime::kCoulomb, v1::REGIME_COULOMB) && same(Regime::kTresca, v1::REGIME_TRESCA) &&
              same(Regime::kMelting, v1::REGIME_MELTING));
static_assert(same(kOutcomeOk, v1::OUTCOME_OK) && same(kSubstepped, v1::OUTCOME_SUBSTEPPED) &&
              same(kMultipleRoots, v1::OUTCOME_MULTIPLE_ROOTS) && same(kOutsideDomain, v1::OUTCOME_OUTSIDE_DOMAIN) &&
              same(kFirstOrder, v1::OUTCOME_FIRST_ORDER) && same(kFailed, v1::OUTCOME_FAILED));
static_assert(same(Strategy::kVelocityDriven, v1::STRATEGY_VELOCITY_DRIVEN) &&
              same(Strategy::kForceDriven, v1::STRATEGY_FORCE_DRIVEN) &&
              same(FarBoundary::kInsulated, v1::FAR_BOUNDARY_INSULATED) &&
              same(FarBoundary::kHalfSpace, v1::FAR_BOUNDARY_HALF_SPACE) &&
              same(TimeIntegrator::kBackwardEuler, v1::TIME_INTEGRATOR_BACKWARD_EULER) &&
              same(TimeIntegrator::kSdirk2, v1::TIME_INTEGRATOR_SDIRK2) && same(Heat::kProfile, v1::HEAT_PROFILE) &&
              same(Heat::kModes, v1::HEAT_MODES) && same(Drive::kLayerShear, v1::DRIVE_LAYER_SHEAR) &&
              same(Drive::kInterfaceSlip, v1::DRIVE_INTERFACE_SLIP) &&
              same(InterfaceLaw::kSubgrid, v1::INTERFACE_LAW_SUBGRID) &&
              same(InterfaceLaw::kCoulombTresca, v1::INTERFACE_LAW_COULOMB_TRESCA) &&
              same(InterfaceLaw::kFreeSlip, v1::INTERFACE_LAW_FREE_SLIP) &&
              same(InterfaceLaw::kStick, v1::INTERFACE_LAW_STICK) &&
              same(InterfaceLaw::kConstant, v1::INTERFACE_LAW_CONSTANT) && same(Symmetry::kPlane, v1::SYMMETRY_PLANE) &&
              same(Symmetry::kAxisymmetric, v1::SYMMETRY_AXISYMMETRIC) && same(Shell::kCylinder, v1::SHELL_CYLINDER) &&
              same(Shell::kSphere, v1::SHELL_SPHERE) && same(GasTest::kNoh, v1::GAS_TEST_NOH) &&
              same(GasTest::kSedov, v1::GAS_TEST_SEDOV) && same(GasTest::kSaltzman, v1::GAS_TEST_SALTZMAN) &&
              same(FarEnd::kTransmitting, v1::FAR_END_TRANSMITTING) && same(FarEnd::kFree, v1::FAR_END_FREE));
static_assert(same(Code::kOk, v1::CODE_OK) && same(Code::kBadFraming, v1::CODE_BAD_FRAMING) &&
              same(Code::kMalformed, v1::CODE_MALFORMED) && same(Code::kVersion, v1::CODE_VERSION) &&
              same(Code::kLimit, v1::CODE_LIMIT) && same(Code::kChecksum, v1::CODE_CHECKSUM) &&
              same(Code::kShape, v1::CODE_SHAPE) && same(Code::kUnsupported, v1::CODE_UNSUPPORTED) &&
              same(Code::kUnknownSession, v1::CODE_UNKNOWN_SESSION) &&
              same(Code::kStaleSequence, v1::CODE_STALE_SEQUENCE) && same(Code::kSequenceGap, v1::CODE_SEQUENCE_GAP) &&
              same(Code::kSequenceReused, v1::CODE_SEQUENCE_REUSED) && same(Code::kEpoch, v1::CODE_EPOCH) &&
              same(Code::kNothingToCommit, v1::CODE_NOTHING_TO_COMMIT) &&
              same(Code::kInvalidScene, v1::CODE_INVALID_SCENE) && same(Code::kInvalidValue, v1::CODE_INVALID_VALUE) &&
              same(Code::kUnknownNode, v1::CODE_UNKNOWN_NODE) && same(Code::kDuplicateNode, v1::CODE_DUPLICATE_NODE) &&
              same(Code::kShuttingDown, v1::CODE_SHUTTING_DOWN) && same(Code::kInternal, v1::CODE_INTERNAL) &&
              same(Code::kResumeRefused, v1::CODE_RESUME_REFUSED) && same(Code::kSuperseded, v1::CODE_SUPERSEDED) &&
              same(Code::kUnknownMark, v1::CODE_UNKNOWN_MARK) && same(Code::kNoSpace, v1::CODE_NO_SPACE) &&
              same(Code::kTrialStands, v1::CODE_TRIAL_STANDS) &&
              same(Code::kUnknownTransfer, v1::CODE_UNKNOWN_TRANSFER) && same(Code::kNodeOwned, v1::CODE_NODE_OWNED) &&
              same(Code::kOtherScene, v1::CODE_OTHER_SCENE) && same(Code::kStepFailed, v1::CODE_STEP_FAILED) &&
              same(Code::kNotPermitted, v1::CODE_NOT_PERMITTED) && same(Code::kDraining, v1::CODE_DRAINING) &&
              same(Code::kCheckpointFailed, v1::CODE_CHECKPOINT_FAILED));
static_assert(same(Top::kHottest, v1::TOP_HOTTEST) && same(Top::kFastest, v1::TOP_FASTEST) &&
              same(Top::kMolten, v1::TOP_MOLTEN));

[[noreturn]] void refuse(Code code, std::string text, std::string field) {
  throw Error({.code = code, .text = std::move(text), .field = std::move(field)});
}

bool is_none(const SessionId& id) {
  return std::all_of(id.begin(), id.end(), [](std::uint8_t byte) { return byte == 0; });
}

std::string id_bytes(const SessionId& id) {
  return is_none(id) ? std::string() : std::string(id.begin(), id.end());
}

std::span<const std::byte> bytes_of(const std::string& text) {
  return std::as_bytes(std::span(text));
}

// ---- values to messages ----

void put_scene(const Scene& scene, v1::Scene& message) {
  to_message(scene, message);
  message.clear_hydro();  // the guest's own business
}

void put(const Hello& from, v1::RequestHeader& header) {
  v1::Hello& to = *header.mutable_hello();
  to.set_oldest_major(from.oldest_major);
  to.set_newest_major(from.newest_major);
  to.set_client_name(as_utf8(from.client_name, kMaxTextBytes));
}
void put(const OpenSession& from, v1::RequestHeader& header) {
  put_scene(from.scene, *header.mutable_open_session()->mutable_scene());
  header.mutable_open_session()->set_session_id(id_bytes(from.session_id));
  header.mutable_open_session()->set_resume_token(id_bytes(from.resume_token));
  header.mutable_open_session()->set_domain(as_utf8(from.domain, kMaxTextBytes));
}
void put(const Downscale& from, v1::RequestHeader& header) {
  v1::Downscale& to = *header.mutable_downscale();
  to.set_dt_s(from.dt_s);
  to.set_time_s(from.time_s);
  to.set_step(from.step);
  to.set_attempt(from.attempt);
  to.set_mode(static_cast<v1::Mode>(from.mode));
  to.set_commit_previous(from.commit_previous);
  for (Field field : from.wanted) to.add_wanted(static_cast<std::uint32_t>(field));
  to.set_policy(static_cast<v1::Policy>(from.policy));
}
void put(const Commit&, v1::RequestHeader& header) {
  header.mutable_commit();
}
void put(const Rollback& from, v1::RequestHeader& header) {
  header.mutable_rollback()->set_to_mark(as_utf8(from.to_mark, kMaxTextBytes));
}
void put(const Mark& from, v1::RequestHeader& header) {
  header.mutable_mark()->set_name(as_utf8(from.name, kMaxTextBytes));
}
void put(const RegisterNodes&, v1::RequestHeader& header) {
  header.mutable_register_nodes();
}
void put(const RetireNodes&, v1::RequestHeader& header) {
  header.mutable_retire_nodes();
}
void put(const OfferNodes& from, v1::RequestHeader& header) {
  header.mutable_offer_nodes()->set_transfer_id(id_bytes(from.transfer_id));
}
void put(const AcceptNodes& from, v1::RequestHeader& header) {
  header.mutable_accept_nodes()->set_transfer_id(id_bytes(from.transfer_id));
}
void put(const CloseSession& from, v1::RequestHeader& header) {
  header.mutable_close_session()->set_reason(as_utf8(from.reason, kMaxTextBytes));
}
void put(const ServerStatusQuery&, v1::RequestHeader& header) {
  header.mutable_server_status();
}
void put(const Checkpoint&, v1::RequestHeader& header) {
  header.mutable_checkpoint();
}
void put(const Drain& from, v1::RequestHeader& header) {
  header.mutable_drain()->set_exit(from.exit);
}
void put(const Inspect& from, v1::RequestHeader& header) {
  header.mutable_inspect()->set_after(id_bytes(from.after));
  header.mutable_inspect()->set_top(static_cast<v1::Top>(from.top));
  header.mutable_inspect()->set_count(from.count);
}
void put(const ResumeSession& from, v1::RequestHeader& header) {
  v1::ResumeSession& to = *header.mutable_resume_session();
  to.set_resume_token(id_bytes(from.resume_token));
  to.set_claim(from.claim);
  to.set_claimant(from.claimant);
}

void put(const Welcome& from, v1::ReplyHeader& header) {
  v1::Welcome& to = *header.mutable_welcome();
  to.set_protocol_major(from.protocol_major);
  to.set_protocol_minor(from.protocol_minor);
  to.set_server_version(as_utf8(from.server_version, kMaxTextBytes));
  to.mutable_limits()->set_max_header_bytes(from.limits.max_header_bytes);
  to.mutable_limits()->set_max_payload_bytes(from.limits.max_payload_bytes);
  to.mutable_limits()->set_max_nodes_per_session(from.limits.max_nodes_per_session);
  to.mutable_limits()->set_max_sessions(from.limits.max_sessions);
  to.mutable_limits()->set_max_marks(from.limits.max_marks);
  to.mutable_limits()->set_max_frames(from.limits.max_frames);
  to.mutable_limits()->set_max_state_bytes(from.limits.max_state_bytes);
  for (const std::string& capability : from.capabilities) to.add_capabilities(as_utf8(capability, kMaxTextBytes));
  to.set_durability(as_utf8(from.durability, kMaxTextBytes));
  to.set_access(as_utf8(from.access, kMaxTextBytes));
}
void put(const SessionOpened& from, v1::SessionOpened& to) {
  put_scene(from.effective_scene, *to.mutable_effective_scene());
  to.set_bytes_per_node(from.bytes_per_node);
  for (const std::string& warning : from.warnings) to.add_warnings(as_utf8(warning, kMaxTextBytes));
}
void put(const SessionOpened& from, v1::ReplyHeader& header) {
  put(from, *header.mutable_session_opened());
}
void put(const SessionResumed& from, v1::ReplyHeader& header) {
  v1::SessionResumed& to = *header.mutable_session_resumed();
  put(from.session, *to.mutable_session());
  to.set_last_sequence(from.last_sequence);
  to.set_state_version(from.state_version);
  to.set_trial_stands(from.trial_stands);
  to.set_claim(from.claim);
  for (const TransferId& offer : from.offers) to.add_offers(id_bytes(offer));
}
void put(const Upscale& from, v1::ReplyHeader& header) {
  v1::Upscale& to = *header.mutable_upscale();
  to.set_nodes(from.nodes);
  to.set_state_version(from.state_version);
  to.set_solver_ns(from.solver_ns);
  to.set_service_ns(from.service_ns);
  to.set_flagged_nodes(from.flagged_nodes);
}
void put(const Committed& from, v1::ReplyHeader& header) {
  header.mutable_committed()->set_state_version(from.state_version);
}
void put(const RolledBack& from, v1::ReplyHeader& header) {
  header.mutable_rolled_back()->set_state_version(from.state_version);
}
void put(const Marked& from, v1::ReplyHeader& header) {
  v1::Marked& to = *header.mutable_marked();
  to.set_state_version(from.state_version);
  for (const std::string& mark : from.names) to.add_names(as_utf8(mark, kMaxTextBytes));
}
void put(const NodesChanged& from, v1::ReplyHeader& header) {
  header.mutable_nodes_changed()->set_nodes(from.nodes);
}
void put(const SessionClosed& from, v1::ReplyHeader& header) {
  v1::SessionClosed& to = *header.mutable_session_closed();
  to.set_requests(from.requests);
  to.set_node_steps(from.node_steps);
  to.set_solver_ns(from.solver_ns);
}
void put(const ServerStatus& from, v1::ReplyHeader& header) {
  to_message(from, *header.mutable_server_status());
}
void put(const Inspected& from, v1::ReplyHeader& header) {
  to_message(from, *header.mutable_inspected());
}
void put(const Checkpointed& from, v1::ReplyHeader& header) {
  header.mutable_checkpointed()->set_bytes(from.bytes);
  header.mutable_checkpointed()->set_duration_ns(from.duration_ns);
}
void put(const Draining& from, v1::ReplyHeader& header) {
  header.mutable_draining()->set_sessions(from.sessions);
}
template <typename Header>
void put(const std::monostate&, Header&) {}

void put_status(const Status& from, v1::Status& to) {
  to.set_code(static_cast<v1::Code>(from.code));
  to.set_text(as_utf8(from.text, kMaxTextBytes));
  to.set_remedy(as_utf8(from.remedy, kMaxTextBytes));
  to.set_field(as_utf8(from.field, kMaxTextBytes));
  const std::size_t named = std::min(from.node_ids.size(), kMaxNodesNamed);
  to.mutable_node_ids()->Add(from.node_ids.begin(), from.node_ids.begin() + static_cast<std::ptrdiff_t>(named));
  to.set_last_sequence(from.last_sequence);
}

template <typename Value, typename Header>
void put_envelope(const Value& value, Header& header) {
  header.Clear();
  header.set_magic(kMagic);
  header.set_protocol_major(value.protocol_major);
  header.set_protocol_minor(value.protocol_minor);
  header.set_request_id(value.request_id);
  header.set_session_id(id_bytes(value.session_id));
  header.set_sequence(value.sequence);
  header.set_epoch(value.epoch);
  std::visit([&](const auto& body) { put(body, header); }, value.body);
}

// ---- messages to values ----

Scene take_scene(const v1::Scene& message) {
  Scene scene = from_message(message);
  scene.hydro.reset();
  return scene;
}

Hello take(const v1::Hello& from) {
  return {.oldest_major = from.oldest_major(), .newest_major = from.newest_major(), .client_name = from.client_name()};
}
OpenSession take(const v1::OpenSession& from) {
  if (!from.has_scene()) refuse(Code::kMalformed, "open_session has no scene", "open_session.scene");
  return {.scene = take_scene(from.scene()),
          .session_id = id_from(bytes_of(from.session_id()), "open_session.session_id"),
          .resume_token = id_from(bytes_of(from.resume_token()), "open_session.resume_token"),
          .domain = from.domain()};
}
Downscale take(const v1::Downscale& from) {
  Downscale to{.dt_s = from.dt_s(),
               .time_s = from.time_s(),
               .step = from.step(),
               .attempt = from.attempt(),
               .mode = static_cast<Mode>(from.mode()),
               .commit_previous = from.commit_previous(),
               .wanted = {},
               .policy = static_cast<Policy>(from.policy())};
  if (to.mode == Mode::kUnspecified)
    refuse(Code::kMalformed, "downscale.mode is not given, expected ADVANCE or TRIAL", "downscale.mode");
  if (static_cast<std::size_t>(from.wanted_size()) > kMaxColumns)
    refuse(Code::kShape, fmt::format("{} columns wanted, at most {} allowed", from.wanted_size(), kMaxColumns),
           "downscale.wanted");
  for (std::uint32_t number : from.wanted()) {
    if (!v1::Field_IsValid(static_cast<int>(number)) || number == 0)
      refuse(Code::kShape, fmt::format("wanted column {} is not a field of this protocol", number), "downscale.wanted");
    to.wanted.push_back(static_cast<Field>(number));
  }
  return to;
}
CloseSession take(const v1::CloseSession& from) {
  return {.reason = from.reason()};
}

ResumeSession take(const v1::ResumeSession& from) {
  return {.resume_token = id_from(bytes_of(from.resume_token()), "resume_session.resume_token"),
          .claim = from.claim(),
          .claimant = from.claimant()};
}

Welcome take(const v1::Welcome& from) {
  return {.protocol_major = from.protocol_major(),
          .protocol_minor = from.protocol_minor(),
          .server_version = from.server_version(),
          .limits = {.max_header_bytes = from.limits().max_header_bytes(),
                     .max_payload_bytes = from.limits().max_payload_bytes(),
                     .max_nodes_per_session = from.limits().max_nodes_per_session(),
                     .max_sessions = from.limits().max_sessions(),
                     .max_marks = from.limits().max_marks(),
                     .max_frames = from.limits().max_frames(),
                     .max_state_bytes = from.limits().max_state_bytes()},
          .capabilities = {from.capabilities().begin(), from.capabilities().end()},
          .durability = from.durability(),
          .access = from.access()};
}
SessionOpened take(const v1::SessionOpened& from) {
  if (!from.has_effective_scene())
    refuse(Code::kMalformed, "session_opened has no effective scene", "session_opened.effective_scene");
  return {.effective_scene = take_scene(from.effective_scene()),
          .bytes_per_node = from.bytes_per_node(),
          .warnings = {from.warnings().begin(), from.warnings().end()}};
}
SessionResumed take(const v1::SessionResumed& from) {
  if (static_cast<std::size_t>(from.offers_size()) > kMaxOffers)
    refuse(Code::kLimit, fmt::format("{} offers, at most {} allowed", from.offers_size(), kMaxOffers),
           "session_resumed.offers");
  SessionResumed to{.session = take(from.session()),
                    .last_sequence = from.last_sequence(),
                    .state_version = from.state_version(),
                    .trial_stands = from.trial_stands(),
                    .claim = from.claim(),
                    .offers = {}};
  for (const std::string& offer : from.offers())
    to.offers.push_back(id_from(bytes_of(offer), "session_resumed.offers"));
  return to;
}
Upscale take(const v1::Upscale& from) {
  return {.nodes = from.nodes(),
          .state_version = from.state_version(),
          .solver_ns = from.solver_ns(),
          .service_ns = from.service_ns(),
          .flagged_nodes = from.flagged_nodes()};
}
SessionClosed take(const v1::SessionClosed& from) {
  return {.requests = from.requests(), .node_steps = from.node_steps(), .solver_ns = from.solver_ns()};
}
Inspect take(const v1::Inspect& from) {
  return {.after = id_from(bytes_of(from.after()), "inspect.after"),
          .top = static_cast<Top>(from.top()),
          .count = from.count()};
}
void take_body(const v1::RequestHeader& header, Request& message) {
  switch (header.body_case()) {
    case v1::RequestHeader::kHello:
      message.body = take(header.hello());
      break;
    case v1::RequestHeader::kOpenSession:
      message.body = take(header.open_session());
      break;
    case v1::RequestHeader::kDownscale:
      message.body = take(header.downscale());
      break;
    case v1::RequestHeader::kCommit:
      message.body = Commit{};
      break;
    case v1::RequestHeader::kRollback:
      message.body = Rollback{.to_mark = header.rollback().to_mark()};
      break;
    case v1::RequestHeader::kCloseSession:
      message.body = take(header.close_session());
      break;
    case v1::RequestHeader::kServerStatus:
      message.body = ServerStatusQuery{};
      break;
    case v1::RequestHeader::kResumeSession:
      message.body = take(header.resume_session());
      break;
    case v1::RequestHeader::kMark:
      message.body = Mark{.name = header.mark().name()};
      break;
    case v1::RequestHeader::kRegisterNodes:
      message.body = RegisterNodes{};
      break;
    case v1::RequestHeader::kRetireNodes:
      message.body = RetireNodes{};
      break;
    case v1::RequestHeader::kOfferNodes:
      message.body = OfferNodes{id_from(bytes_of(header.offer_nodes().transfer_id()), "offer_nodes.transfer_id")};
      break;
    case v1::RequestHeader::kAcceptNodes:
      message.body = AcceptNodes{id_from(bytes_of(header.accept_nodes().transfer_id()), "accept_nodes.transfer_id")};
      break;
    case v1::RequestHeader::kCheckpoint:
      message.body = Checkpoint{};
      break;
    case v1::RequestHeader::kDrain:
      message.body = Drain{.exit = header.drain().exit()};
      break;
    case v1::RequestHeader::kInspect:
      message.body = take(header.inspect());
      break;
    case v1::RequestHeader::BODY_NOT_SET:
      refuse(Code::kMalformed, "the request has no body: nothing is asked", "body");
  }
}

Status take_status(const v1::Status& from) {
  if (static_cast<std::size_t>(from.node_ids_size()) > kMaxNodesNamed)
    refuse(Code::kLimit, fmt::format("status names {} nodes, at most {} allowed", from.node_ids_size(), kMaxNodesNamed),
           "status.node_ids");
  if (from.code() == v1::CODE_UNSPECIFIED) refuse(Code::kMalformed, "the reply has no status code", "status.code");
  return {.code = static_cast<Code>(from.code()),
          .text = from.text(),
          .remedy = from.remedy(),
          .field = from.field(),
          .node_ids = {from.node_ids().begin(), from.node_ids().end()},
          .last_sequence = from.last_sequence()};
}

void take_body(const v1::ReplyHeader& header, Reply& message) {
  message.replayed = header.replayed();
  message.status = take_status(header.status());
  const bool has_body = header.body_case() != v1::ReplyHeader::BODY_NOT_SET;
  if (has_body != message.status.ok())
    refuse(Code::kMalformed,
           fmt::format("reply of status {} has {} body", name(message.status.code), has_body ? "a" : "no"), "body");
  switch (header.body_case()) {
    case v1::ReplyHeader::kWelcome:
      message.body = take(header.welcome());
      break;
    case v1::ReplyHeader::kSessionOpened:
      message.body = take(header.session_opened());
      break;
    case v1::ReplyHeader::kUpscale:
      message.body = take(header.upscale());
      break;
    case v1::ReplyHeader::kCommitted:
      message.body = Committed{header.committed().state_version()};
      break;
    case v1::ReplyHeader::kRolledBack:
      message.body = RolledBack{header.rolled_back().state_version()};
      break;
    case v1::ReplyHeader::kSessionClosed:
      message.body = take(header.session_closed());
      break;
    case v1::ReplyHeader::kServerStatus:
      message.body = from_message(header.server_status());
      break;
    case v1::ReplyHeader::kMarked:
      message.body = Marked{.state_version = header.marked().state_version(),
                            .names = {header.marked().names().begin(), header.marked().names().end()}};
      break;
    case v1::ReplyHeader::kNodesChanged:
      message.body = NodesChanged{header.nodes_changed().nodes()};
      break;
    case v1::ReplyHeader::kSessionResumed:
      message.body = take(header.session_resumed());
      break;
    case v1::ReplyHeader::kCheckpointed:
      message.body =
          Checkpointed{.bytes = header.checkpointed().bytes(), .duration_ns = header.checkpointed().duration_ns()};
      break;
    case v1::ReplyHeader::kDraining:
      message.body = Draining{.sessions = header.draining().sessions()};
      break;
    case v1::ReplyHeader::kInspected:
      message.body = from_message(header.inspected());
      break;
    case v1::ReplyHeader::BODY_NOT_SET:
      break;
  }
}

}  // namespace

void to_message(const Request& request, v1::RequestHeader& message) {
  put_envelope(request, message);
}

void to_message(const Reply& reply, v1::ReplyHeader& message) {
  put_envelope(reply, message);
  put_status(reply.status, *message.mutable_status());
  message.set_replayed(reply.replayed);
}

void from_message(const v1::RequestHeader& message, Request& request) {
  take_body(message, request);
}
void from_message(const v1::ReplyHeader& message, Reply& reply) {
  take_body(message, reply);
}

SessionId id_from(std::span<const std::byte> bytes, const char* field) {
  SessionId id{};
  if (!bytes.empty() && bytes.size() != id.size())
    refuse(Code::kMalformed, fmt::format("{} has {} bytes, expected {} (or none)", field, bytes.size(), id.size()),
           field);
  if (!bytes.empty()) std::memcpy(id.data(), bytes.data(), id.size());
  return id;
}

}  // namespace shearbus::wire
