#include "server/embedded.hpp"

#include <sys/eventfd.h>
#include <unistd.h>

#include <cstdint>
#include <stdexcept>
#include <thread>

#include "proto/wire/host_process.hpp"
#include "server/server.hpp"

namespace shearbus::server {
namespace {

constexpr const char* kEndpoint = "inproc://shearbus";  // one name suffices: each server has its own context

class StopEvent {
 public:
  StopEvent() : file_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (file_ < 0) throw std::runtime_error("the embedded server got no eventfd: " + wire::limit_of_files());
  }
  StopEvent(const StopEvent&) = delete;
  StopEvent& operator=(const StopEvent&) = delete;
  ~StopEvent() { ::close(file_); }

  int file() const { return file_; }
  void set() const {
    const std::uint64_t one = 1;
    // The write fails only if the counter of the eventfd is at its maximum, and then the event is set already.
    [[maybe_unused]] const ssize_t written = ::write(file_, &one, sizeof one);
  }

 private:
  int file_;
};

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

  StopEvent stop;
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
