// Requests as values to header messages and back.
#include <fmt/format.h>

#include <cstring>

#include "proto/wire/header_message.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::wire {
namespace {

void put(const Hello& from, v1::RequestHeader& header) {
  v1::Hello& to = *header.mutable_hello();
  to.set_oldest_major(from.oldest_major);
  to.set_newest_major(from.newest_major);
  to.set_client_name(as_utf8(from.client_name, kMaxTextBytes));
}
void put(const OpenSession& from, v1::RequestHeader& header) {
  v1::OpenSession& to = *header.mutable_open_session();
  to.set_scene(scene_text(from.scene, "open_session.scene"));
  to.set_scene_file(as_utf8(from.scene_file, kMaxTextBytes));
  to.set_session_id(id_bytes(from.session_id));
  to.set_resume_token(id_bytes(from.resume_token));
  to.set_domain(as_utf8(from.domain, kMaxTextBytes));
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

void put(const std::monostate&, v1::RequestHeader&) {}

Hello take(const v1::Hello& from) {
  return {.oldest_major = from.oldest_major(), .newest_major = from.newest_major(), .client_name = from.client_name()};
}
OpenSession take(const v1::OpenSession& from) {
  if (from.scene().empty()) refuse(Code::kMalformed, "open_session has no scene", "open_session.scene");
  return {.scene = from.scene(),
          .scene_file = from.scene_file(),
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

Inspect take(const v1::Inspect& from) {
  return {.after = id_from(bytes_of(from.after()), "inspect.after"),
          .top = static_cast<Top>(from.top()),
          .count = from.count()};
}

}  // namespace

void to_message(const Request& request, v1::RequestHeader& message) {
  put_header(request, message);
  std::visit([&](const auto& body) { put(body, message); }, request.body);
}

void from_message(const v1::RequestHeader& header, Request& message) {
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

SessionId id_from(std::span<const std::byte> bytes, const char* field) {
  SessionId id{};
  if (!bytes.empty() && bytes.size() != id.size())
    refuse(Code::kMalformed, fmt::format("{} has {} bytes, expected {} (or none)", field, bytes.size(), id.size()),
           field);
  if (!bytes.empty()) std::memcpy(id.data(), bytes.data(), id.size());
  return id;
}

}  // namespace shearbus::wire
