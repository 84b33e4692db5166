// The server's interface to its operating system: resources in use, and notifications of a service manager such as
// systemd.
#pragma once

#include <cstdint>
#include <string>

#include "proto/wire/handle.hpp"

namespace shearbus::server {

std::uint64_t monotonic_ns();   // a clock that never goes back
std::uint64_t thread_cpu_ns();  // processor time that the calling thread has used

struct ProcessUse {
  std::uint64_t resident_bytes = 0;
  std::uint64_t open_files = 0;
  std::uint64_t max_open_files = 0;
};
ProcessUse process_use();

// True if this process has used four fifths of its file descriptors. Without free descriptors no client can connect.
bool files_run_out();

// The protocol of sd_notify(3): datagrams to the socket named in NOTIFY_SOCKET. Without that variable all calls do
// nothing.
class ServiceManager {
 public:
  ServiceManager();  // reads NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID from the environment

  void ready(const std::string& status);
  void stopping();
  // Tells the watchdog of the service manager that the server works. Must be called only by the loop that answers
  // requests, once a second, so that a stuck loop is noticed.
  void alive();
  // Tells the manager to wait longer for ready().
  void recovering(int percent);
  // Between these two calls the watchdog waits longer, because no request is answered during a checkpoint.
  void checkpoint_begins();
  void checkpoint_ends();

 private:
  void send(const std::string& message) const;

  wire::Descriptor socket_;
  std::uint64_t watchdog_us_ = 0;  // the manager ends a server that is not alive() for this time  [µs]; 0: no watchdog
  bool stopping_ = false;
};

}  // namespace shearbus::server
