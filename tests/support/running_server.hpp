// A server with real sockets on a thread of the test's process. Unlike server::Embedded, it listens on endpoints that
// the test chooses.
#pragma once

#include <sys/eventfd.h>
#include <unistd.h>

#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "client/src/client.hpp"
#include "server/server.hpp"
#include "tests/support/scratch.hpp"

namespace shearbus::support {

using ScratchDirectory = test::Scratch;

class RunningServer {
 public:
  explicit RunningServer(const server::ServerOptions& options = {}, const std::vector<std::string>& endpoints = {},
                         const server::Log& log = {})
      : stop_(::eventfd(0, EFD_CLOEXEC)), server_(open_to_tests(options), log) {
    std::vector<std::string> wanted = endpoints;
    if (wanted.empty()) wanted = {scratch_.ipc(), "tcp://127.0.0.1:*", "inproc://test"};
    for (const std::string& endpoint : wanted) endpoints_.push_back(server_.bind(endpoint));
    thread_ = std::thread([this] { server_.run(stop_); });
  }
  RunningServer(const RunningServer&) = delete;
  RunningServer& operator=(const RunningServer&) = delete;
  ~RunningServer() {
    stop();
    ::close(stop_);
  }

  void stop() {
    if (!thread_.joinable()) return;
    const std::uint64_t one = 1;
    if (::write(stop_, &one, sizeof one) != sizeof one) std::abort();
    thread_.join();
  }

  // Returns the server's endpoint whose URI scheme is `scheme`: "ipc", "tcp" or "inproc".
  const std::string& endpoint(const std::string& scheme = "ipc") const {
    for (const std::string& endpoint : endpoints_)
      if (endpoint.starts_with(scheme + "://")) return endpoint;
    throw std::runtime_error("the server does not listen by " + scheme);
  }
  const std::vector<std::string>& endpoints() const { return endpoints_; }
  void* context() { return server_.context(); }

  ClientOptions client_options(const std::string& scheme = "ipc") {
    ClientOptions options;
    options.endpoint = endpoint(scheme);
    // most tests send velocity jumps that do not follow from the earlier answers
    options.check_closure = CheckClosure::kOff;
    if (scheme == "inproc") options.context = context();
    return options;
  }
  Client client(const std::string& scheme = "ipc") { return Client(client_options(scheme)); }

  server::Server& server() { return server_; }

  // Returns the counters of the transport. The server must be stopped, or idle after a reply.
  const transport::RouterCounters& transport() const { return server_.transport(); }

 private:
  static server::ServerOptions open_to_tests(server::ServerOptions options) {
    options.insecure_plaintext = options.curve_secret.empty();
    return options;
  }

  ScratchDirectory scratch_;
  int stop_;
  server::Server server_;
  std::vector<std::string> endpoints_;
  std::thread thread_;
};

}  // namespace shearbus::support
