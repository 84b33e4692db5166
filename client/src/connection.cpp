#include "client/src/connection.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <random>
#include <stdexcept>
#include <string_view>
#include <thread>
#include <utility>
#include <variant>
#include <vector>
#include <zmq.hpp>

#include "client/src/host_name.hpp"
#include "proto/files/endpoint_file.hpp"
#include "proto/files/key_file.hpp"
#include "proto/wire/codec.hpp"
#include "proto/wire/host_process.hpp"
#include "proto/wire/numbers.hpp"
#include "proto/wire/text.hpp"

namespace shearbus {
namespace {

constexpr std::string_view kOwnProcess = "inproc://";
constexpr std::size_t kCopiedUpTo =
    std::size_t{16} * 1024;  // largest payload that is copied within the process  [bytes]
constexpr const char* kAddresses =
    "Give what the log of the server names: tcp://HOST:PORT with the name of its machine, ipc://PATH of its socket, or "
    "file://PATH of its endpoint file.";
constexpr int kReconnectMs = 100;
constexpr int kReconnectMaxMs = 5'000;
constexpr int kHeartbeatMs = 2'000;
constexpr int kHeartbeatTimeoutMs = 6'000;
constexpr int kHandshakeMs = 5'000;
constexpr int kFramesBeforeLook = 90;  // most frames read from a socket since it was found empty
constexpr int kSilentFailures = 3;     // failed handshakes in a row after which a wrong key is reported
constexpr std::chrono::milliseconds kRecoveryPause{200};  // time between two requests to a server that recovers
constexpr std::chrono::milliseconds kFilePause{50};       // time between two looks at an endpoint file
constexpr std::chrono::milliseconds kFileLook{500};       // likewise while the server that it names does not answer
constexpr std::chrono::seconds kFirstNotice{2};           // waiting time before the log says what a call waits for
constexpr std::chrono::seconds kFirstNoticeOnScreen{10};  // the same for standard error, where the host has no log
constexpr std::chrono::milliseconds kInterruptLook{100};  // time between two calls of ClientOptions::interrupted
constexpr std::size_t kLongestShown = 1024;               // of an endpoint in messages  [bytes]
constexpr long kLongestSleepMs = 3'600'000;               // of one call of poll()
constexpr int kGoodbyeLingerMs = 100;  // longest time that an unsent closing request delays the program's end

// The bytes of a frame that was received.
std::span<const std::byte> view_of(const zmq::message_t& frame) {
  return {static_cast<const std::byte*>(frame.data()), frame.size()};
}
std::span<const std::byte> view_of(const std::shared_ptr<void>& frame) {
  return frame ? view_of(*static_cast<const zmq::message_t*>(frame.get())) : std::span<const std::byte>();
}

[[noreturn]] void unreachable(const std::string& where, const std::string& why) {
  throw Error({.code = Code::kUnreachable, .text = fmt::format("{}: {}", where, why)});
}

// Refuses an endpoint at which no server can be, or none is.
[[noreturn]] void refuse_endpoint(std::string text, std::string remedy) {
  throw Error({.code = Code::kUnreachable, .text = std::move(text), .remedy = std::move(remedy), .field = "endpoint"});
}

// Throws Error for a tcp endpoint without a port that one can connect to.
void check_port(std::string_view endpoint) {
  constexpr std::string_view kTcp = "tcp://";
  constexpr std::uint64_t kLastPort = 65535;
  if (!endpoint.starts_with(kTcp)) return;
  const std::size_t colon = endpoint.rfind(':');  // where there is no port, that of the scheme
  const std::string_view port = colon < kTcp.size() ? std::string_view() : endpoint.substr(colon + 1);
  if (const auto number = wire::count_of(port, kLastPort); number && *number > 0) return;
  refuse_endpoint(fmt::format("{}: expected a port from 1 to {} at the end, found {}",
                              wire::printable(endpoint, kLongestShown), kLastPort, wire::in_quotes(port)),
                  "Write tcp://HOST:PORT, with the port that the log of the server names.");
}

void check_endpoint(const ClientOptions& options) {
  const std::string_view endpoint = options.endpoint;
  const bool file = endpoint.starts_with(files::kFileScheme);  // the server's key is in the file
  const auto known = {std::string_view("tcp://"), std::string_view("ipc://"), kOwnProcess, files::kFileScheme};
  const auto has = [&](std::string_view scheme) { return endpoint.starts_with(scheme) && endpoint != scheme; };
  if (std::none_of(known.begin(), known.end(), has))
    refuse_endpoint(fmt::format("\"{}\" is not an endpoint", wire::printable(endpoint, kLongestShown)),
                    "Use tcp://host:port, ipc://path, file://path of an endpoint file, or \"embedded\" for a server in "
                    "this process.");
  check_port(endpoint);
  if (endpoint.starts_with(kOwnProcess) && options.context == nullptr)
    refuse_endpoint(fmt::format("{} can be reached only by the program that started the server", endpoint),
                    "Leave the endpoint out for a server in this process, or give that of another server.");
  if (options.server_key.empty() && options.secret_key.empty()) return;
  if (!file && !endpoint.starts_with("tcp://"))
    throw Error({.code = Code::kAuth,
                 .text = fmt::format("{} takes no keys: it is on this machine, where the user is known", endpoint),
                 .remedy = "Leave out server_key_file and secret_key_file (of a program: --server-key, --key)."});
  const bool server_key_known = files::is_key(options.server_key) || (file && options.server_key.empty());
  if (!server_key_known || !files::is_key(options.secret_key))
    throw Error(
        {.code = Code::kAuth,
         .text = fmt::format("server_key or secret_key is not a key of {} characters of Z85", files::kKeyCharacters),
         .remedy = "Give both, or neither; shearbus-ctl keygen makes a pair."});
}

// The call of a host that makes a request of this verb: "step" for downscale, "open" for open_session.
std::string_view call_of(std::string_view verb) {
  return verb == wire::Downscale::kBody.name ? "step" : verb.substr(0, verb.find('_'));
}

}  // namespace

const char* verb_of(const wire::Request& request) {
  return std::visit(
      []<typename Body>(const Body&) {
        if constexpr (wire::HasRows<const Body>)
          return Body::kBody.name;
        else
          return "";
      },
      request.body);
}

void SocketConnection::CloseSocket::operator()(void* socket) const {
  zmq_socket_monitor(socket, nullptr, 0);  // stops the events, which nobody reads any more
  zmq_close(socket);
}
void SocketConnection::CloseContext::operator()(void* context) const {
  wire::uninterrupted([&] { return zmq_ctx_term(context); });
}

// Of the caller, or this connection's own, whose threads start with the first socket.
void* SocketConnection::context() {
  if (options().context != nullptr) return options().context;
  if (own_context_) return own_context_.get();
  try {
    wire::check_room_for_sockets();
  } catch (const std::runtime_error& fault) {
    unreachable(where_, fault.what());
  }
  own_context_.reset(zmq_ctx_new());
  if (!own_context_) unreachable(where_, fmt::format("no context of libzmq: {}", zmq_strerror(zmq_errno())));
  return own_context_.get();
}

// Makes a socket, whose kind the fault names.
void* SocketConnection::new_socket(int type, const char* kind) {
  void* const parent = context();
  void* const socket = wire::uninterrupted([&] { return zmq_socket(parent, type); });
  if (socket == nullptr) no_socket(kind);
  return socket;
}

void SocketConnection::no_socket(const char* kind) const {
  unreachable(where_, zmq_errno() == EMFILE ? fmt::format("no {}: {}", kind, wire::limit_of_files())
                                            : fmt::format("no {}: {}", kind, zmq_strerror(zmq_errno())));
}

SocketConnection::SocketConnection(ClientOptions options) : Connection(std::move(options)) {
  check_endpoint(this->options());
  if (!this->options().record.empty()) start_recording();
  if (in_process() && !recorder_) leave_out_payload_sums();
}

bool SocketConnection::in_process() const {
  return options().endpoint.starts_with(kOwnProcess);
}

// A recording that cannot be made is reported, and is no error of the host.
void SocketConnection::start_recording() {
  const auto report = [log = options().log](const std::string& line) { write_line(log, line); };
  try {
    recorder_.emplace(files::RecorderOptions{.place = options().record,
                                             .recorder = files::Recorder::kClient,
                                             .sessions = {},
                                             .log = [report](const std::string& line, bool) { report(line); }});
  } catch (const std::exception& fault) {
    report(fmt::format("SHEARBUS_RECORD: nothing is recorded: {}", fault.what()));
  }
}

void SocketConnection::record(const std::string& header, const wire::Batch& batch,
                              std::span<const std::byte> reply_header,
                              std::span<const std::byte> reply_payload) noexcept {
  if (recorder_)
    recorder_->add({.request_header = std::as_bytes(std::span(header)),
                    .request_payload = batch.bytes(),
                    .reply_header = reply_header,
                    .reply_payload = reply_payload});
}

SocketConnection::~SocketConnection() = default;

void write_line(const std::function<void(const std::string& line)>& log, const std::string& line) {
  if (log) return log(line);
  fmt::print(stderr, "shearbus: {}\n", line);
}

KeyPair make_key_pair() {
  std::array<char, files::kKeyCharacters + 1> public_key{};
  std::array<char, files::kKeyCharacters + 1> secret_key{};
  if (zmq_curve_keypair(public_key.data(), secret_key.data()) != 0)
    throw std::runtime_error("this libzmq was built without CURVE: it makes no keys");
  return {public_key.data(), secret_key.data()};
}

std::uint64_t Connection::next_request_id() {
  if (last_request_id_ == 0) {
    std::random_device random;
    last_request_id_ = (std::uint64_t{random()} << 32) | random();
  }
  if (++last_request_id_ == 0) ++last_request_id_;
  return last_request_id_;
}

std::chrono::milliseconds Connection::left_since(Clock::time_point started) const {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(started + options().reply_deadline - now());
  return std::max(left, std::chrono::milliseconds(1));
}

void Connection::heed(const wire::Welcome& welcome) {
  durable_ = welcome.durability != "none";
  set_max_rows(welcome.limits.max_rows_per_message);
  parts_ahead_ = std::ranges::find(welcome.capabilities, "parts_ahead") != welcome.capabilities.end();
}

void Connection::pause(std::chrono::milliseconds time) {
  std::this_thread::sleep_for(time);
}

bool SocketConnection::by_file() const {
  return options().endpoint.starts_with(files::kFileScheme);
}

// Finds the address of the server. An endpoint file is read before each new socket, because a restarted server may
// listen elsewhere. Returns false, with the fault in file_fault_ or refusal_, if the file cannot be used.
bool SocketConnection::find_server() {
  server_ = {.endpoint = options().endpoint, .server_key = options().server_key, .secret_key = options().secret_key};
  where_ = wire::printable(options().endpoint, kLongestShown);
  if (!by_file()) return true;
  files::EndpointFile file;
  const std::string path = where_.substr(files::kFileScheme.size());
  try {
    file = files::read_endpoint_file(path);
  } catch (const std::runtime_error& fault) {
    if (files::may_become_endpoint_file(path))
      file_fault_ = fault.what();
    else
      refusal_ = {.code = Code::kUnreachable,
                  .text = fmt::format("expected an endpoint file of a server, found another file: {}", fault.what()),
                  .remedy = "Name the file that the server got as --endpoint-file.",
                  .field = "endpoint"};
    return false;
  }
  file_fault_.clear();
  file_epoch_ = file.epoch;
  where_ = fmt::format("{} (named by {}, written on {})", file.endpoint, where_, file.host);
  server_.endpoint = file.endpoint;
  const auto refuse = [this](std::string why, std::string remedy) {
    refusal_ = {.code = Code::kAuth, .text = fmt::format("{}: {}", where_, why), .remedy = std::move(remedy)};
    return false;
  };
  const bool expects_server_key = !server_.server_key.empty();
  if (file.endpoint.starts_with("ipc://")) {
    if (expects_server_key)
      return refuse("a server on this machine proves no key, and this client expects one",
                    "Leave out server_key_file (of a program: --server-key).");
    server_.secret_key.clear();
    return true;
  }
  if (!expects_server_key) server_.server_key = file.server_key;
  if (server_.secret_key.empty() && !server_.server_key.empty())
    return refuse("the server expects clients with keys, and this one has none",
                  "Give secret_key_file (of a program: --key); shearbus-ctl keygen makes a pair.");
  if (!server_.secret_key.empty() && server_.server_key.empty())
    return refuse("the server has no keys, and this client has one to prove itself",
                  "Leave out secret_key_file (of a program: --key), or have the server started with --curve-secret.");
  return true;
}

// True if the endpoint file is that of another start of a server than the one socket_ connects to.
bool SocketConnection::server_has_moved() const {
  try {
    return files::read_endpoint_file(options().endpoint.substr(files::kFileScheme.size())).epoch != file_epoch_;
  } catch (const std::runtime_error&) {
    return false;  // a server that has ended; the next one writes the file again
  }
}

// Makes a socket that connects to the server. Returns false if the endpoint file names no server to connect to.
bool SocketConnection::connect() {
  refusal_ = {};
  if (!find_server()) return false;
  // At such a file libzmq would go on trying for ever.
  const bool ipc = server_.endpoint.starts_with("ipc://");
  const std::string path = ipc ? server_.endpoint.substr(std::strlen("ipc://")) : "";
  struct stat found {};
  if (ipc && ::stat(path.c_str(), &found) == 0 && !S_ISSOCK(found.st_mode))
    refuse_endpoint(where_ + ": expected the socket of a server, found another file or a directory", kAddresses);
  if (ipc && ::faccessat(AT_FDCWD, path.c_str(), W_OK, AT_EACCESS) != 0 && errno == EACCES)
    throw Error({.code = Code::kAuth,
                 .text = fmt::format("{}: uid {} may not connect there", where_, ::geteuid()),
                 .remedy = fmt::format("Run as the server's user, or have it started with --allow-uid {}, in a "
                                       "directory that other users can enter.",
                                       ::geteuid())});
  frames_read_ = 0;
  socket_.reset(new_socket(ZMQ_DEALER, "socket"));
  zmq::socket_ref socket(zmq::from_handle, socket_.get());
  socket.set(zmq::sockopt::immediate, true);  // queues nothing until the connection is established
  socket.set(zmq::sockopt::linger, 0);
  socket.set(zmq::sockopt::maxmsgsize, static_cast<std::int64_t>(wire::kMaxPayloadBytes));
  socket.set(zmq::sockopt::reconnect_ivl, kReconnectMs);
  socket.set(zmq::sockopt::reconnect_ivl_max, kReconnectMaxMs);
  socket.set(zmq::sockopt::handshake_ivl, kHandshakeMs);
  socket.set(zmq::sockopt::heartbeat_ivl, kHeartbeatMs);
  socket.set(zmq::sockopt::heartbeat_timeout, kHeartbeatTimeoutMs);
  socket.set(zmq::sockopt::tcp_keepalive, 1);
  if (server_.endpoint.starts_with("tcp://[")) socket.set(zmq::sockopt::ipv6, true);
  if (!server_.server_key.empty()) {
    socket.set(zmq::sockopt::curve_serverkey, server_.server_key);
    socket.set(zmq::sockopt::curve_publickey, own_public_key());
    socket.set(zmq::sockopt::curve_secretkey, server_.secret_key);
  }
  watch_handshakes();
  file_ = socket.get(zmq::sockopt::fd);
  monitor_file_ = zmq::socket_ref(zmq::from_handle, monitor_.get()).get(zmq::sockopt::fd);
  monitor_unread_ = true;
  if (wire::uninterrupted([&] { return zmq_connect(socket_.get(), server_.endpoint.c_str()); }) != 0) {
    const std::string why =
        zmq_errno() == ENAMETOOLONG
            ? fmt::format("the path has {} bytes, and the path of a socket has at most {}; choose a shorter one",
                          path.size(), wire::kLongestSocketPath)
        : zmq_errno() == EINVAL ? "a client cannot connect to this"
                                : zmq_strerror(zmq_errno());
    socket_.reset();
    refuse_endpoint(where_ + ": " + why, kAddresses);
  }
  return true;
}

std::string SocketConnection::own_public_key() const {
  std::array<char, files::kKeyCharacters + 1> key{};
  zmq_curve_public(key.data(), server_.secret_key.c_str());  // cannot fail, because is_key() has accepted the key
  return key.data();
}

void SocketConnection::watch_handshakes() {
  // The names must be unique in the context, which other clients and other copies of this library may share.
  static std::atomic<unsigned> counter{0};
  const std::string name = fmt::format("inproc://shearbus-client-{}-{}", static_cast<void*>(&counter), ++counter);
  constexpr int kEvents = ZMQ_EVENT_HANDSHAKE_SUCCEEDED | ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL |
                          ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH;
  monitor_.reset(new_socket(ZMQ_PAIR, "monitor"));
  const int unlimited = 0;  // an event without space in the queue would block the I/O thread
  if (wire::uninterrupted([&] { return zmq_socket_monitor(socket_.get(), name.c_str(), kEvents); }) != 0 ||
      zmq_setsockopt(monitor_.get(), ZMQ_RCVHWM, &unlimited, sizeof unlimited) != 0 ||
      wire::uninterrupted([&] { return zmq_connect(monitor_.get(), name.c_str()); }) != 0)
    no_socket("monitor");
}

void SocketConnection::read_handshakes() {
  for (;;) {
    zmq::message_t event;
    zmq::message_t address;
    if (wire::uninterrupted([&] { return zmq_msg_recv(event.handle(), monitor_.get(), ZMQ_DONTWAIT); }) < 0) return;
    wire::uninterrupted([&] { return zmq_msg_recv(address.handle(), monitor_.get(), 0); });
    std::uint16_t number = 0;
    std::uint32_t detail = 0;
    if (event.size() < sizeof number + sizeof detail) continue;
    std::memcpy(&number, event.data(), sizeof number);
    std::memcpy(&detail, static_cast<const char*>(event.data()) + sizeof number, sizeof detail);
    handshake_failed(number, detail);
  }
}

// Stores the reason of a failed handshake if a retry is useless.
void SocketConnection::handshake_failed(int event, std::uint32_t detail) {
  const bool keys = !server_.server_key.empty();
  const auto refused = [&](std::string why, std::string remedy) {
    refusal_ = {
        .code = Code::kAuth, .text = fmt::format("{}: {}", where_, std::move(why)), .remedy = std::move(remedy)};
  };
  if (event == ZMQ_EVENT_HANDSHAKE_SUCCEEDED) {
    silent_failures_ = 0;
  } else if (event == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH && keys) {
    refused("the server does not admit this client's key",
            fmt::format("Ask its operator to add this line to the file --authorized-keys or, if it is there, to look "
                        "what the log says of the file: {} {}",
                        own_public_key(), options().name));
  } else if (event == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH) {
    refused(fmt::format("the server does not admit this client, of uid {}", ::geteuid()),
            fmt::format("Run as the server's user, or have it started with --allow-uid {}.", ::geteuid()));
  } else if (event == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL && detail == ZMQ_PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH) {
    if (keys)
      refused("the server has no keys, and this client expects it to prove that it is the right one",
              "Leave out server_key_file and secret_key_file (of a program: --server-key, --key), or have the server "
              "started with --curve-secret.");
    else
      refused(
          "the server expects clients with keys, and this one has none",
          "Give server_key_file and secret_key_file (of a program: --server-key, --key); shearbus-ctl keygen makes a "
          "pair.");
  } else if (keys &&
             ((event == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL && detail == ZMQ_PROTOCOL_ERROR_ZMTP_CRYPTOGRAPHIC) ||
              (event == ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL && ++silent_failures_ == kSilentFailures))) {
    // A server that cannot decrypt the handshake, because it was encrypted for another key, sends no reason.
    refused(
        "the connection is broken off in the handshake: the server has no keys, or not the secret one to server_key",
        "Take the server's public key from the line it logs at its start.");
  }
}

void SocketConnection::refused(bool sent) const {
  if (!sent) throw Error(refusal_);
  throw Error({.code = Code::kUnknownOutcome,
               .text = fmt::format("{}; the request had been sent before, and may or may not have run", refusal_.text),
               .remedy = refusal_.remedy});
}

// Waits until the socket is ready for `events`. Returns false if `until` passed first, or if the server refused the
// connection.
bool SocketConnection::wait(short events, Clock::time_point until) {
  for (;;) {
    // Rounds up, because a timeout of 0 ms would be a busy loop.
    auto wake = std::min(until, waiting_.next_notice);
    if (options().interrupted) wake = std::min(wake, Clock::now() + kInterruptLook);
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(wake - Clock::now()).count();
    const auto [ready, told] = sleep(events, std::max<long>(left, 0));
    if (ready) return true;
    if (told) read_handshakes();
    if (!refusal_.ok()) return false;
    if (Clock::now() >= until) return false;
    if (host_ends_call()) return false;
    notice(events);
  }
}

// Asks the host, which may have been told to stop. A call that it ends is refused like one of a client without access:
// its outcome is unknown if it was sent.
bool SocketConnection::host_ends_call() {
  if (!options().interrupted || !options().interrupted()) return false;
  refusal_ = {.code = Code::kUnreachable,
              .text = fmt::format("{}: the host was interrupted while it waited", where_),
              .remedy = "Make the same call again: if it has run, it is not run a second time."};
  return true;
}

// Waits until the socket may be ready for `events` (first), or its monitor has something to tell (second).
//
// For a message poll() of the sockets' files is enough: receive() has just found no message and read_handshakes() no
// event, and libzmq makes the files readable when there is one after that. zmq_poll() would look at both sockets before
// and after it sleeps, and ask the kernel each time.
std::pair<bool, bool> SocketConnection::sleep(short events, long wait_ms) {
  if (events == ZMQ_POLLIN) {
    if (std::exchange(monitor_unread_, false)) read_handshakes();
    if (!refusal_.ok()) return {false, false};
    std::array<pollfd, 2> files = {
        {{.fd = file_, .events = POLLIN, .revents = 0}, {.fd = monitor_file_, .events = POLLIN, .revents = 0}}};
    const int found = ::poll(files.data(), files.size(), static_cast<int>(std::min<long>(wait_ms, kLongestSleepMs)));
    if (found < 0 && errno != EINTR) unreachable(where_, std::strerror(errno));
    return {found > 0 && files[0].revents != 0, found > 0 && files[1].revents != 0};
  }
  monitor_unread_ = true;
  std::array<zmq_pollitem_t, 2> items = {{{socket_.get(), 0, events, 0}, {monitor_.get(), 0, ZMQ_POLLIN, 0}}};
  const int found = zmq_poll(items.data(), static_cast<int>(items.size()), wait_ms);
  if (found < 0 && zmq_errno() != EINTR) unreachable(where_, zmq_strerror(zmq_errno()));
  return {found > 0 && items[0].revents != 0, found > 0 && items[1].revents != 0};
}

std::chrono::seconds SocketConnection::first_notice() const {
  return options().log ? kFirstNotice : kFirstNoticeOnScreen;
}

// Says for what the call waits, when it is time to.
void SocketConnection::notice(short events) {
  if (Clock::now() < waiting_.next_notice) return;
  const auto waited = Clock::now() - waiting_.since;
  waiting_.next_notice = waiting_.since + 2 * waited;
  const double seconds = std::chrono::duration<double>(waited).count();
  if (events == ZMQ_POLLOUT)
    write_line(options().log, fmt::format("waiting for a server at {} to connect to, since {:.0f} s{}{}", where_,
                                          seconds, file_fault_.empty() ? "" : "; ", file_fault_));
  else
    write_line(options().log, fmt::format("waiting for the answer of {} to the call {}, since {:.0f} s", where_,
                                          call_of(waiting_.verb), seconds));
}

// A message of these bytes, which are copied unless it keeps their memory: they belong to the caller, and libzmq may keep
// a message beyond the call that sends it if a reply is lost.
zmq::message_t message_of(std::span<const std::byte> bytes, std::shared_ptr<const void> keeper) {
  if (!keeper || bytes.size() <= kCopiedUpTo) return {bytes.data(), bytes.size()};
  auto held = std::make_unique<std::shared_ptr<const void>>(std::move(keeper));
  // libzmq's interface takes a pointer to non-const but does not change the bytes.
  zmq::message_t message(
      const_cast<std::byte*>(bytes.data()), bytes.size(),
      [](void*, void* hint) { delete static_cast<std::shared_ptr<const void>*>(hint); }, held.get());
  static_cast<void>(held.release());
  return message;
}

// Sends without waiting. Returns false if there is no connection (yet).
bool SocketConnection::send(const std::string& header, const wire::Batch& batch) {
  const bool has_payload = !batch.columns().empty();
  const auto keeper = has_payload && in_process() ? batch.keeper() : nullptr;
  const auto send_frame = [&](std::span<const std::byte> bytes, bool more) {
    zmq::message_t message = message_of(bytes, more ? nullptr : keeper);
    const int flags = ZMQ_DONTWAIT | (more ? ZMQ_SNDMORE : 0);
    if (wire::uninterrupted([&] { return zmq_msg_send(message.handle(), socket_.get(), flags); }) >= 0) return true;
    if (zmq_errno() == EAGAIN) return false;
    unreachable(where_, zmq_strerror(zmq_errno()));
  };
  if (!send_frame(std::as_bytes(std::span(header)), has_payload)) return false;
  return !has_payload || send_frame(batch.bytes(), false);
}

// Finds the socket empty before it has been found full too often. Late replies to repeated requests are dropped.
void SocketConnection::look() {
  while (socket_ && frames_read_ > kFramesBeforeLook / 2) {
    zmq::message_t late;
    if (frames_read_ > kFramesBeforeLook) return drop_socket();
    if (wire::uninterrupted([&] { return zmq_msg_recv(late.handle(), socket_.get(), ZMQ_DONTWAIT); }) >= 0)
      ++frames_read_;
    else if (zmq_errno() == EAGAIN)
      frames_read_ = 0;
    else
      unreachable(where_, zmq_strerror(zmq_errno()));
  }
}

// Waits for the reply to `request_id` and skips replies to earlier requests. Returns false if `until` passed first, or
// if the request must be sent again on a fresh socket.
//
// libzmq 4.3.4 aborts the process (fq.cpp:112) if it notices, between two frames of a message that has arrived whole,
// that the connection is lost: with ZMQ_IMMEDIATE it then gives up the rest of the message. While messages arrive it
// looks for such notices at every hundredth call of zmq_msg_recv() on a socket, counted from the last call that found
// nothing. So each message is preceded by a call that finds nothing; where one never does, the socket is replaced in
// time. Between two calls nothing is to come, so look() finds nothing and the socket stays.
bool SocketConnection::receive(std::uint64_t request_id, Clock::time_point until, Received& received) {
  for (;;) {
    if (frames_read_ > kFramesBeforeLook) return false;
    zmq::message_t header;
    zmq::message_t surplus;
    std::shared_ptr<zmq::message_t> payload;  // where it stays: a small frame has its bytes inside
    std::array<std::span<const std::byte>, wire::kMaxFrames + 1> views;
    std::size_t count = 0;
    for (bool more = true; more && count < views.size();) {  // decode() refuses three frames
      if (count == 1 && !payload) payload = std::make_shared<zmq::message_t>();
      zmq::message_t& frame = count == 0 ? header : count == 1 ? *payload : surplus;
      if (wire::uninterrupted([&] { return zmq_msg_recv(frame.handle(), socket_.get(), ZMQ_DONTWAIT); }) < 0) {
        if (zmq_errno() == EAGAIN) break;
        unreachable(where_, zmq_strerror(zmq_errno()));
      }
      ++frames_read_;
      more = frame.more();
      views[count++] = view_of(frame);
    }
    if (count == 0) {
      frames_read_ = 0;
      if (!wait(ZMQ_POLLIN, until)) return false;
      continue;
    }
    try {
      received.reply = wire::Reply();
      if (payload_sum() == wire::PayloadSum::kLeftOut)
        wire::decode(std::span(views.data(), count), received.reply, wire::PayloadSum::kLeftOut);
      else
        wire::decode(std::span(views.data(), count), received.reply);
    } catch (const Error& fault) {
      throw Error({.code = Code::kUnexpectedReply,
                   .text = fmt::format("{} sent what is no reply: {}", where_, describe(fault.status())),
                   .remedy = "Is it a shearbus server of this version?"});
    }
    // A reply has the id 0 if the server could not read the id of the request.
    if (received.reply.request_id != request_id && (received.reply.request_id != 0 || received.reply.status.ok()))
      continue;
    received.payload_frame = std::move(payload);
    if (recorder_) reply_header_frame_ = std::make_shared<zmq::message_t>(std::move(header));
    answered_ = true;
    return true;
  }
}

void SocketConnection::post(const wire::Request& request) {
  posted_.reset();
  behind_.reset();
  try {
    look();
    if (!socket_ && !connect()) return;
    const auto now = Clock::now();
    header_ = wire::encode_header(request, std::move(header_), payload_sum());
    if (send(header_, request.batch)) posted_ = Posted{request.request_id, now};
  } catch (...) {
    drop_socket();  // the socket may hold a part of the request
    throw;
  }
}

void SocketConnection::post_behind(const wire::Request& request) {
  if (!socket_ || !posted_) return;
  try {
    const auto now = Clock::now();
    if (send(wire::encode_header(request, {}, payload_sum()), request.batch)) behind_ = Posted{request.request_id, now};
  } catch (...) {
    drop_socket();  // it may hold a part of the request
    throw;
  }
}

// What was sent and not called yet may be lost with the socket, and is sent again when it is called.
void SocketConnection::drop_socket() {
  socket_.reset();
  posted_.reset();
  behind_.reset();
}

Received SocketConnection::call(const wire::Request& request, std::chrono::milliseconds deadline) {
  waiting_ = {.since = Clock::now(), .next_notice = Clock::now() + first_notice(), .verb = verb_of(request)};
  Received received;
  try {
    received = exchange(request, deadline);
  } catch (...) {
    drop_socket();  // the socket may hold a part of the request or of the reply
    throw;
  }
  posted_ = std::exchange(behind_, std::nullopt);
  if (!received.reply.status.ok()) {
    posted_.reset();  // what was sent behind a refused request may be refused, too, and is sent again when it is called
    throw Error(received.reply.status);
  }
  return received;
}

Received SocketConnection::exchange(const wire::Request& request, std::chrono::milliseconds deadline) {
  const auto started = Clock::now();
  auto last_moment = started + deadline;
  const std::string& header = header_ = wire::encode_header(request, std::move(header_), payload_sum());
  bool under_way = posted_ && posted_->request_id == request.request_id;
  const auto asked = under_way ? posted_->at : started;
  posted_.reset();
  if (!under_way) {
    behind_.reset();
    look();
  }
  bool sent = under_way;
  for (;;) {
    while (!socket_ && !connect()) {
      if (!refusal_.ok()) refused(sent);
      if (Clock::now() >= last_moment) give_up(sent, Clock::now() - started);
      notice(ZMQ_POLLOUT);
      pause(kFilePause);
      if (host_ends_call()) refused(sent);
    }
    while (!under_way && !send(header, request.batch)) {
      const auto look = by_file() ? std::min(last_moment, Clock::now() + kFileLook) : last_moment;
      if (wait(ZMQ_POLLOUT, look)) continue;
      if (refusal_.ok() && Clock::now() < last_moment) {
        if (!server_has_moved()) continue;
        drop_socket();
        break;
      }
      if (sent) record(header, request.batch);
      if (!refusal_.ok()) refused(sent);
      give_up(sent, Clock::now() - started);
    }
    if (!socket_) continue;  // to connect to the server where it is now
    under_way = false;
    sent = true;
    Received received;
    if (receive(request.request_id, std::min(last_moment, Clock::now() + options().retry_after), received)) {
      if (received.reply.status.code == Code::kRecovering && options().wait_for_recovery) {
        // The server is at work and answers when it has recovered: the deadline begins anew.
        recovering(received.reply.status);
        last_moment = Clock::now() + deadline;
        behind_.reset();
        continue;
      }
      received.round_trip = Clock::now() - asked;
      if (recorder_) record(header, request.batch, view_of(reply_header_frame_), view_of(received.payload_frame));
      return received;
    }
    drop_socket();
    if (!refusal_.ok() || Clock::now() >= last_moment) record(header, request.batch);
    if (!refusal_.ok()) refused(sent);
    if (Clock::now() >= last_moment) give_up(sent, Clock::now() - started);
  }
}

// Waits a moment and says from time to time for what.
void SocketConnection::recovering(const wire::Status& status) {
  pause(kRecoveryPause);
  if (host_ends_call()) refused(true);
  if (Clock::now() < waiting_.next_notice) return;
  waiting_.next_notice = Clock::now() + first_notice();
  write_line(options().log, fmt::format("waiting for the server at {}: {}", where_, status.text));
}

void SocketConnection::give_up(bool sent, Clock::duration waited) const {
  const double seconds = std::chrono::duration<double>(waited).count();
  if (!sent && !file_fault_.empty())
    refuse_endpoint(
        fmt::format("no endpoint file of a server within {:.1f} s: {}", seconds, file_fault_),
        "Is a server running? It writes the file when it listens: shearbus-server --endpoint-file FILE, for "
        "clients with file://FILE.");
  if (!sent && answered_)
    refuse_endpoint(fmt::format("the server at {} has stopped answering; it was waited for {:.1f} s", where_, seconds),
                    "Has it been stopped, or its machine? Sessions of a server with --state-dir continue when it is "
                    "started again.");
  if (!sent) {
    if (const std::string fault = fault_of_host_name(server_.endpoint); !fault.empty())
      refuse_endpoint(fmt::format("no server was found at {} within {:.1f} s: {}", where_, seconds, fault),
                      "Write the address of the server's machine, or a name that \"getent ahostsv4 NAME\" knows here.");
    constexpr std::string_view kIpc = "ipc://";
    if (server_.endpoint.starts_with(kIpc) && wire::is_served(std::string_view(server_.endpoint).substr(kIpc.size())))
      refuse_endpoint(fmt::format("the server at {} lives, and did not answer within {:.1f} s", where_, seconds),
                      "Is its process stopped (SIGSTOP, a debugger) or its machine overloaded? Let it go on, or end it "
                      "and start it "
                      "again: with --state-dir its sessions continue.");
    refuse_endpoint(fmt::format("no server answered at {} within {:.1f} s", where_, seconds),
                    by_file() ? "A server that is killed leaves its file behind: start it again, or remove the file."
                              : fmt::format("Is one running? Start it with: shearbus-server --bind {}{}", where_,
                                            !where_.starts_with("tcp://") ? ""
                                            : server_.secret_key.empty()
                                                ? " --insecure-plaintext, or give both sides keys (shearbus-ctl keygen)"
                                                : " --curve-secret FILE --authorized-keys FILE"));
  }
  throw Error({.code = Code::kUnknownOutcome,
               .text = fmt::format("{} did not answer within {:.1f} s; the request may or may not have run{}{}", where_,
                                   seconds, file_fault_.empty() ? "" : "; ", file_fault_),
               .remedy = "Make the same call again: if it has run, it is not run a second time."});
}

void SocketConnection::say(const wire::Request& request) noexcept try {
  if (!socket_) return;
  const int linger = kGoodbyeLingerMs;
  zmq_setsockopt(socket_.get(), ZMQ_LINGER, &linger, sizeof linger);
  const std::string header = wire::encode_header(request);
  send(header, request.batch);
  record(header, request.batch);
} catch (const std::exception&) {
  // A request that cannot be sent is no error here: the server keeps the session.
}

}  // namespace shearbus
