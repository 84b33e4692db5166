// The server and the system it runs on: what it uses of it, and what it tells a service manager such as systemd.
#pragma once

#include <cstdint>
#include <string>

namespace shearbus::server {

struct ProcessUse {
  std::uint64_t resident_bytes = 0;
  std::uint64_t open_files = 0;
  std::uint64_t max_open_files = 0;
};
ProcessUse process_use();

// Whether four fifths of the files this process may open are open: soon nobody can connect any more.
bool files_run_out();

// The protocol of sd_notify(3): datagrams to the socket named in NOTIFY_SOCKET. Without one it does nothing.
class ServiceManager {
 public:
  ServiceManager();  // from the environment
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;
  ~ServiceManager();

  void ready(const std::string& status);
  void stopping();
  // From the loop that answers and commits, and from nowhere else, once a second.
  void alive();
  // A checkpoint may take longer than the watchdog waits.
  void checkpoint_begins();
  void checkpoint_ends();

 private:
  void send(const std::string& message) const;

  int socket_ = -1;
  std::uint64_t watchdog_us_ = 0;  // 0: nobody waits
  bool stopping_ = false;
};

}  // namespace shearbus::server
