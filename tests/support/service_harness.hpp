// A service without a socket. Requests and replies pass through the codec as on the wire; the clock is a counter.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "proto/wire/codec.hpp"
#include "proto/wire/messages.hpp"
#include "server/service/service.hpp"
#include "server/shard/task_pool.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus::support {

struct Answer {
  service::ReplyFrames frames;
  wire::Reply reply;  // decoded reply; its batch points into `frames`

  std::vector<std::byte> payload() const { return {frames.payload.begin(), frames.payload.end()}; }
  wire::Code code() const { return reply.status.code; }
};

inline Answer decoded(service::ReplyFrames frames, bool in_process = false) {
  Answer answer{.frames = std::move(frames), .reply = {}};
  const std::span<const std::byte> views[2] = {std::as_bytes(std::span(answer.frames.header)), answer.frames.payload};
  const auto sent = std::span(views, answer.frames.has_payload ? 2 : 1);
  if (in_process)
    wire::decode(sent, answer.reply, wire::PayloadSum::kLeftOut);
  else
    wire::decode(sent, answer.reply);
  return answer;
}

struct ServiceHarness {
  explicit ServiceHarness(unsigned threads = 1, service::ServiceOptions options = {})
      : pool(threads), service(complete(std::move(options)), pool) {}

  Answer ask_bytes(service::Frames frames, const service::Caller& caller = {}) {
    auto answered = service.handle(frames, caller);
    if (!answered) throw std::runtime_error("the service did not answer");
    return decoded(std::move(*answered), caller.in_process);
  }

  Answer ask(const wire::Request& request, const service::Caller& caller = {}) {
    const auto sum = caller.in_process ? wire::PayloadSum::kLeftOut : wire::PayloadSum::kGiven;
    const std::string header = wire::encode_header(request, {}, sum);
    const std::span<const std::byte> views[2] = {std::as_bytes(std::span(header)), request.batch.bytes()};
    return ask_bytes(std::span(views, request.batch.columns().empty() ? 1 : 2), caller);
  }

  // Asks what is not refused; a refusal is a fault of the test.
  Answer granted(const wire::Request& request, const service::Caller& caller = {}, const char* file = __builtin_FILE(),
                 int line = __builtin_LINE()) {
    Answer answer = ask(request, caller);
    if (answer.code() != wire::Code::kOk)
      throw std::runtime_error(std::string(file) + ":" + std::to_string(line) + ": " + describe(answer.reply.status));
    return answer;
  }

  static wire::SessionId id(std::uint8_t number) {
    wire::SessionId session_id{};
    session_id.fill(number);
    return session_id;
  }

  static wire::Request opening(const v1::Scene& scene, std::span<const std::uint64_t> nodes, std::uint8_t session = 1) {
    return opening(text_of(scene), nodes, session);
  }

  static wire::Request opening(std::string scene, std::span<const std::uint64_t> nodes, std::uint8_t session = 1) {
    wire::Request request;
    request.request_id = 1;
    wire::OpenSession body{.scene = std::move(scene), .session_id = id(session)};
    body.resume_token.fill(9);
    request.body = std::move(body);
    request.batch = id_column(nodes);
    return request;
  }

  // Resumes a session that was opened by opening().
  static wire::Request resuming(std::uint8_t session = 1, std::uint64_t claim = 0, std::uint64_t claimant = 0) {
    wire::ResumeSession body{.claim = claim, .claimant = claimant};
    body.resume_token.fill(9);
    return in_session(std::move(body), 0, session);
  }

  template <typename Body>
  static wire::Request in_session(Body body, std::uint64_t sequence, std::uint8_t session = 1) {
    wire::Request request;
    request.request_id = 1000 + sequence;
    request.session_id = id(session);
    request.sequence = sequence;
    request.body = std::move(body);
    return request;
  }

  template <typename Body>
  static wire::Request of_nodes(Body body, std::span<const std::uint64_t> nodes, std::uint64_t sequence,
                                std::uint8_t session = 1) {
    wire::Request request = in_session(std::move(body), sequence, session);
    request.batch = id_column(nodes);
    return request;
  }

  static wire::Request step(std::uint64_t sequence, wire::Batch batch, wire::Mode mode = wire::Mode::kAdvance,
                            std::uint8_t session = 1) {
    wire::Request request = in_session(wire::Downscale{.dt_s = 1e-9, .mode = mode}, sequence, session);
    request.batch = std::move(batch);
    return request;
  }

  // `part`, a part of a step, as it is sent before the part before it is answered.
  static wire::Request ahead(wire::Request part, const wire::Request& before) {
    const std::string header = wire::encode_header(before);
    const std::array<std::span<const std::byte>, 1> frames = {std::as_bytes(std::span(header))};
    std::get<wire::Downscale>(part.body).follows = wire::hash_of(frames);
    return part;
  }

  std::uint64_t clock = 0;
  // true: the next reading of the clock throws, which simulates a fault inside the server
  bool clock_fails = false;
  std::vector<std::string> log;
  shard::TaskPool pool;
  service::Service service;

 private:
  service::ServiceOptions complete(service::ServiceOptions options) {
    options.epoch = 77;
    options.server_version = "test";
    options.now_ns = [this] {
      if (std::exchange(clock_fails, false)) throw std::runtime_error("the clock stands still");
      return ++clock;
    };
    options.log = [this](const std::string& line) { log.push_back(line); };
    return options;
  }
};

}  // namespace shearbus::support

// The words of requests, for tests of the service.
namespace shearbus::service {
using support::Answer;
using support::ServiceHarness;
using wire::Code;
using wire::Field;
using wire::Mode;
using wire::Policy;
using wire::Strategy;
}  // namespace shearbus::service
