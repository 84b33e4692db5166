#include "proto/files/session_recorder.hpp"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <span>
#include <stdexcept>
#include <system_error>
#include <utility>
#include <variant>

#include "proto/wire/codec.hpp"
#include "proto/wire/envelope_scan.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::files {
namespace {

// The requests that belong to a session; the others ask about the server.
bool is_of_session(std::uint32_t verb) {
  constexpr std::array kVerbs = {
      wire::OpenSession::kBody.number, wire::Downscale::kBody.number,     wire::Commit::kBody.number,
      wire::Rollback::kBody.number,    wire::CloseSession::kBody.number,  wire::ResumeSession::kBody.number,
      wire::Mark::kBody.number,        wire::RegisterNodes::kBody.number, wire::RetireNodes::kBody.number,
      wire::OfferNodes::kBody.number,  wire::AcceptNodes::kBody.number};
  return std::ranges::find(kVerbs, verb) != kVerbs.end();
}

wire::Reply decoded_reply(const ExchangeFrames& frames) {
  wire::Reply reply;
  wire::decode(wire::frames_of({frames.reply_header, frames.reply_payload}), reply);
  return reply;
}

}  // namespace

SessionRecorder::SessionRecorder(RecorderOptions options) : options_(std::move(options)) {
  const std::string place = options_.place.string();
  one_file_ = options_.recorder == Recorder::kClient && !place.ends_with('/') && !std::filesystem::is_directory(place);
  if (one_file_) return;
  if (::mkdir(place.c_str(), 0700) < 0 && errno != EEXIST)
    throw std::runtime_error(
        fmt::format("cannot make the directory {} of recordings: {}", place, std::generic_category().message(errno)));
  if (!std::filesystem::is_directory(place))
    throw std::runtime_error(fmt::format("{} is no directory; recordings need one", place));
}

std::filesystem::path SessionRecorder::file_of(const wire::SessionId& id) const {
  // Half of the id, since the whole id is a secret of its client.
  return one_file_ ? options_.place
                   : options_.place / ("session-" + wire::hexadecimal(std::span(id).first(8)) + ".log");
}

bool SessionRecorder::wanted(const ExchangeFrames& frames, const wire::SessionOpened& opened) const {
  if (options_.sessions.empty()) return true;
  wire::Request request;
  wire::decode(wire::frames_of({frames.request_header, frames.request_payload}), request);
  const auto* open = std::get_if<wire::OpenSession>(&request.body);
  return std::ranges::any_of(options_.sessions, [&](const std::string& name) {
    return name == opened.scene_name || (open != nullptr && wire::is_domain_of_run(open->domain, name));
  });
}

// The time of day in ns. It grows with every record, so that records of several sessions have an order.
std::uint64_t SessionRecorder::time_ns() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const auto ns = static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
  return last_time_ns_ = std::max(last_time_ns_ + 1, ns);
}

// Makes or continues the log of a session of which no exchange has been recorded since the start of the recorder.
// Returns null for a refusal, which tells nothing about the session.
SessionRecorder::Log* SessionRecorder::begin(std::uint32_t verb, const wire::SessionId& id,
                                             const ExchangeFrames& frames) {
  const wire::Reply reply = decoded_reply(frames);
  if (!reply.status.ok() || (verb == wire::CloseSession::kBody.number && reply.replayed)) return nullptr;
  Log& log = sessions_[id];
  std::error_code ignored;
  const std::filesystem::path file = file_of(id);
  if (const auto* opened = std::get_if<wire::SessionOpened>(&reply.body)) {
    if (!wanted(frames, *opened)) return &log;
    if (one_file_ || !std::filesystem::exists(file, ignored))
      log.emplace(file, EventLogHead{.session_id = id,
                                     .created_ns = time_ns(),
                                     .recorder = options_.recorder,
                                     .scene = opened->effective_scene});
  }
  if (!log && !one_file_ && std::filesystem::exists(file, ignored)) log.emplace(file, id);
  if (!log) stop(id, "it was opened before the recording began", false);
  return &log;
}

void SessionRecorder::add(const ExchangeFrames& frames) noexcept try {
  const std::uint32_t verb = wire::scan_envelope(frames.request_header).body;
  if (!is_of_session(verb)) return;
  const bool opening = verb == wire::OpenSession::kBody.number;
  if (opening && frames.reply_header.empty()) return;
  const auto bytes = wire::scan_envelope(opening ? frames.reply_header : frames.request_header).session_id;
  wire::SessionId id{};
  if (bytes.size() != id.size()) return;
  std::ranges::transform(bytes, id.begin(), [](std::byte byte) { return static_cast<std::uint8_t>(byte); });
  try {
    const auto known = sessions_.find(id);
    if (known == sessions_.end() && frames.reply_header.empty()) return;
    Log* const log = known != sessions_.end() ? &known->second : begin(verb, id, frames);
    if (log == nullptr) return;
    if (*log) (*log)->append(frames, time_ns());
    if (verb != wire::CloseSession::kBody.number || frames.reply_header.empty() || !decoded_reply(frames).status.ok())
      return;
    if (*log) (*log)->sync();
    sessions_.erase(id);
  } catch (const std::exception& fault) {
    stop(id, fault.what(), true);
  }
} catch (const std::exception&) {  // no memory to say why a header is malformed: it is not recorded in any case
}

void SessionRecorder::stop(const wire::SessionId& id, const std::string& why, bool failed) noexcept try {
  const bool begun = sessions_[id].has_value();
  sessions_[id].reset();
  if (options_.log)
    options_.log(fmt::format("session {} is not recorded{}: {}", wire::hexadecimal(std::span(id).first(4)),
                             begun ? " any further" : "", why),
                 failed);
} catch (const std::exception&) {
}

}  // namespace shearbus::files
