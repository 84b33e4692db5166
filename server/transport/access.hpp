// Decides which peers may connect: a ZAP handler (ZeroMQ RFC 27) on its own thread, which asks the given function
// `authorise`. It fails closed: if the function throws or blocks, or the thread has died, new connections are refused;
// existing connections stay.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>
#include <zmq.hpp>

#include "proto/wire/host_process.hpp"

namespace shearbus::transport {

// The verified properties of a peer that asks for a connection.
struct Peer {
  enum class Way { kIpc, kCurve, kPlaintext };
  Way way = Way::kPlaintext;
  std::string address;     // network address as libzmq gives it, for log lines
  std::uint32_t uid = 0;   // kIpc: uid of the peer's process, from the kernel
  std::string public_key;  // kCurve: public key as Z85; the handshake has proved that the peer has the secret key
};

struct Admission {
  bool admitted = false;
  std::string user;    // name attached to each message of the peer; not empty
  std::string reason;  // reason of a refusal, for the log
};
using Authorise = std::function<Admission(const Peer&)>;

class AccessHandler {
 public:
  // At most one handler per context, created before the first bind of a guarded socket. `log` is called on the
  // handler's thread.
  AccessHandler(zmq::context_t& context, Authorise authorise, std::function<void(const std::string&)> log);
  AccessHandler(const AccessHandler&) = delete;
  AccessHandler& operator=(const AccessHandler&) = delete;
  ~AccessHandler();

  // Sets the socket options that route the socket's peers to this handler. Call it before the bind.
  static void guard(zmq::socket_t& socket, Peer::Way way);

  std::uint64_t admitted() const { return admitted_; }
  std::uint64_t refused() const { return refused_; }
  bool alive() const { return alive_; }

 private:
  static constexpr std::int64_t kBurstOfLines = 20;

  void run(zmq::socket_t& socket);
  void answer_one(zmq::socket_t& socket);
  Admission judge(const Peer& peer);
  void log_refusal(const std::string& line);

  Authorise authorise_;
  std::function<void(const std::string&)> log_;
  wire::Event stop_{"no eventfd for the access handler"};
  std::int64_t lines_left_ = kBurstOfLines;
  std::chrono::steady_clock::time_point lines_since_ = std::chrono::steady_clock::now();
  std::atomic<std::uint64_t> admitted_{0};
  std::atomic<std::uint64_t> refused_{0};
  std::atomic<bool> alive_{true};
  std::thread thread_;
};

}  // namespace shearbus::transport
