#include "server/transport/access.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <exception>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

namespace shearbus::transport {
namespace {

constexpr const char* kZapEndpoint = "inproc://zeromq.zap.01";
constexpr std::size_t kFixedFrames =
    6;  // frames before the credentials: version, id, domain, address, routing id, mechanism
constexpr int kEnforceDomain = 93;     // ZMQ_ZAP_ENFORCE_DOMAIN, which libzmq's header names in draft builds only
constexpr std::size_t kKeyBytes = 32;  // size of a key in binary form
constexpr std::size_t kKeyText = 41;   // characters of a key in Z85, with the terminating zero

const char* domain_of(Peer::Way way) {
  return std::array{"ipc", "curve", "plaintext"}.at(static_cast<std::size_t>(way));
}

// libzmq gives the address of an ipc peer as "localhost:UID:GID:PID".
std::optional<std::uint32_t> uid_in(std::string_view address) {
  constexpr std::string_view kBefore = "localhost:";
  if (!address.starts_with(kBefore)) return std::nullopt;
  address.remove_prefix(kBefore.size());
  std::uint32_t uid = 0;
  const auto [end, fault] = std::from_chars(address.data(), address.data() + address.size(), uid);
  if (fault != std::errc() || end == address.data() + address.size() || *end != ':') return std::nullopt;
  return uid;
}

// Returns nothing for a request that cannot come from a guarded socket of this server.
std::optional<Peer> peer_of(const std::vector<zmq::message_t>& request) {
  if (request.size() < kFixedFrames || request[0].to_string_view() != "1.0") return std::nullopt;
  const std::string_view domain = request[2].to_string_view();
  const std::string_view mechanism = request[5].to_string_view();
  Peer peer{.address = request[3].to_string()};
  if (domain == domain_of(Peer::Way::kIpc) && mechanism == "NULL") {
    const auto uid = uid_in(peer.address);
    if (!uid) return std::nullopt;
    peer.way = Peer::Way::kIpc;
    peer.uid = *uid;
  } else if (domain == domain_of(Peer::Way::kCurve) && mechanism == "CURVE" && request.size() == kFixedFrames + 1 &&
             request[6].size() == kKeyBytes) {
    std::array<char, kKeyText> text{};
    if (zmq_z85_encode(text.data(), static_cast<const std::uint8_t*>(request[6].data()), kKeyBytes) == nullptr)
      return std::nullopt;
    peer.way = Peer::Way::kCurve;
    peer.public_key = text.data();
  } else if (domain == domain_of(Peer::Way::kPlaintext) && mechanism == "NULL") {
    peer.way = Peer::Way::kPlaintext;
  } else {
    return std::nullopt;
  }
  return peer;
}

}  // namespace

void AccessHandler::guard(zmq::socket_t& socket, Peer::Way way) {
  // Without a ZAP domain libzmq does not ask the handler about peers without keys, and accepts peers of ZMTP 1 and 2,
  // which skip the handshake. Unless the domain is enforced, it accepts every peer if no handler answers.
  socket.set(zmq::sockopt::zap_domain, domain_of(way));
  const int enforce = 1;
  if (zmq_setsockopt(socket.handle(), kEnforceDomain, &enforce, sizeof enforce) != 0) throw zmq::error_t();
}

AccessHandler::AccessHandler(zmq::context_t& context, Authorise authorise, std::function<void(const std::string&)> log)
    : authorise_(std::move(authorise)), log_(std::move(log)) {
  const auto socket = std::make_shared<zmq::socket_t>(context, zmq::socket_type::rep);
  socket->set(zmq::sockopt::linger, 0);
  if (wire::uninterrupted([&] { return zmq_bind(socket->handle(), kZapEndpoint); }) != 0) throw zmq::error_t();
  // Here the socket passes from this thread to the new thread. libzmq permits this because the start of a thread
  // orders the memory accesses of the two threads.
  thread_ = wire::own_thread([this, socket] { run(*socket); });
}

AccessHandler::~AccessHandler() {
  stop_.set();
  thread_.join();
}

void AccessHandler::run(zmq::socket_t& socket) {
  struct Farewell {
    AccessHandler& handler;
    ~Farewell() { handler.alive_ = false; }
  } const farewell{*this};
  try {
    std::array<zmq::pollitem_t, 2> items = {
        {{socket.handle(), 0, ZMQ_POLLIN, 0}, {nullptr, stop_.file(), ZMQ_POLLIN, 0}}};
    for (;;) {
      if (wire::uninterrupted([&] { return zmq_poll(items.data(), static_cast<int>(items.size()), -1); }) < 0)
        throw zmq::error_t();
      if ((items[1].revents & ZMQ_POLLIN) != 0) return;
      if ((items[0].revents & ZMQ_POLLIN) != 0) answer_one(socket);
    }
  } catch (const std::exception& fault) {
    if (log_) log_(std::string("FAILED: the access handler has ended, nobody new is let in: ") + fault.what());
  }
}

void AccessHandler::answer_one(zmq::socket_t& socket) {
  std::vector<zmq::message_t> request;
  for (bool more = true; more;) {
    zmq::message_t frame;
    if (wire::uninterrupted([&] { return zmq_msg_recv(frame.handle(), socket.handle(), ZMQ_DONTWAIT); }) < 0) {
      if (zmq_errno() == EAGAIN) return;
      throw zmq::error_t();
    }
    more = frame.more();
    request.push_back(std::move(frame));
  }
  Admission admission{.reason = "a request this handler does not understand"};
  std::string who = "a peer";
  if (const auto peer = peer_of(request)) {
    who = peer->address;
    admission = judge(*peer);
  }
  ++(admission.admitted ? admitted_ : refused_);
  if (!admission.admitted) log_refusal("REFUSED connection from " + who + ": " + admission.reason);
  const std::string id = request.size() > 1 ? request[1].to_string() : std::string();
  const std::array<std::string, 6> reply = {
      "1.0", id, admission.admitted ? "200" : "400", admission.admitted ? "OK" : "refused", admission.user, ""};
  for (std::size_t i = 0; i < reply.size(); ++i) {
    const int more = i + 1 < reply.size() ? ZMQ_SNDMORE : 0;
    if (wire::uninterrupted([&] { return zmq_send(socket.handle(), reply[i].data(), reply[i].size(), more); }) < 0)
      throw zmq::error_t();
  }
}

// Limits refusals in the log to one line per second after a burst, so that strangers cannot fill the disk.
void AccessHandler::log_refusal(const std::string& line) {
  const auto now = std::chrono::steady_clock::now();
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(now - lines_since_).count();
  if (seconds > 0) {
    lines_left_ = std::min<std::int64_t>(kBurstOfLines, lines_left_ + seconds);
    lines_since_ = now;
  }
  if (lines_left_ == 0 || !log_) return;
  --lines_left_;
  log_(line + " (" + std::to_string(refused_) + " refused so far)");
}

Admission AccessHandler::judge(const Peer& peer) {
  try {
    Admission admission = authorise_(peer);
    // A decision without a user is a refusal: messages without a user count as messages of this process.
    if (admission.admitted && admission.user.empty()) admission = {.reason = "it has no user"};
    return admission;
  } catch (const std::exception& fault) {
    return {.reason = std::string("it could not be judged: ") + fault.what()};
  }
}

}  // namespace shearbus::transport
