#include "server/embedded.hpp"

#include <thread>

#include "proto/wire/host_process.hpp"
#include "server/server.hpp"

namespace shearbus::server {
namespace {

constexpr const char* kEndpoint = "inproc://shearbus";  // one name suffices: each server has its own context

}  // namespace

struct Embedded::Impl {
  explicit Impl(const ServerOptions& options) : server(options) {
    server.bind(kEndpoint);
    server.recover();
    thread = wire::own_thread([this] {
      try {
        server.run(stop.file());
      } catch (const std::exception&) {
        // The server stops answering, which clients notice by their deadlines; the host process continues.
      }
    });
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    stop.set();
    thread.join();
  }

  wire::Event stop{"the embedded server got no eventfd"};
  Server server;
  std::thread thread;
  std::string endpoint = kEndpoint;
};

Embedded::Embedded(const ServerOptions& options) {
  // What the constructors compute here, and the threads that libzmq starts, have no more of the host's than own threads.
  const wire::SignalsBlocked blocked;
  const wire::DefaultFloatingPoint floating_point;
  impl_ = std::make_unique<Impl>(options);
}
Embedded::Embedded(Embedded&&) noexcept = default;
Embedded& Embedded::operator=(Embedded&&) noexcept = default;
Embedded::~Embedded() = default;

const std::string& Embedded::endpoint() const {
  return impl_->endpoint;
}
void* Embedded::context() const {
  return impl_->server.context();
}

}  // namespace shearbus::server
