// Who may connect: a ZAP handler (ZeroMQ RFC 27) on a thread of its own, which asks a function of the caller's. It
// fails closed: where the function throws, does not come back, or the thread has died, nobody new is let in; those who
// are in already stay.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>
#include <zmq.hpp>

namespace shearbus::transport {

// A connection that is being made, as far as it can be trusted.
struct Peer {
  enum class Way { kIpc, kCurve, kPlaintext };
  Way way = Way::kPlaintext;
  std::string address;     // for people
  std::uint32_t uid = 0;   // of the process, kIpc: the kernel's word
  std::string public_key;  // kCurve, as Z85: the peer has shown that it holds the secret one
};

struct Admission {
  bool admitted = false;
  std::string user;    // comes with each of the peer's messages; not empty
  std::string reason;  // of a refusal, for the log
};
using Authorise = std::function<Admission(const Peer&)>;

class AccessHandler {
 public:
  // One for each context, before the first bind of a socket that it guards. `log` is called on the handler's thread.
  AccessHandler(zmq::context_t& context, Authorise authorise, std::function<void(const std::string&)> log);
  AccessHandler(const AccessHandler&) = delete;
  AccessHandler& operator=(const AccessHandler&) = delete;
  ~AccessHandler();

  // What a socket must be told before a bind so that its peers are judged here.
  static void guard(zmq::socket_t& socket, Peer::Way way);

  std::uint64_t admitted() const { return admitted_; }
  std::uint64_t refused() const { return refused_; }
  bool alive() const { return alive_; }

 private:
  static constexpr std::int64_t kBurstOfLines = 20;

  void run(zmq::socket_t socket);
  void answer_one(zmq::socket_t& socket);
  Admission judge(const Peer& peer);
  void log_refusal(const std::string& line);

  Authorise authorise_;
  std::function<void(const std::string&)> log_;
  int stop_;
  std::int64_t lines_left_ = kBurstOfLines;
  std::chrono::steady_clock::time_point lines_since_ = std::chrono::steady_clock::now();
  std::atomic<std::uint64_t> admitted_{0};
  std::atomic<std::uint64_t> refused_{0};
  std::atomic<bool> alive_{true};
  std::thread thread_;
};

}  // namespace shearbus::transport
