// The server: constructs its parts in the order of their dependencies. The server program and the embedded server each
// consist of this class and a way to stop it.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "proto/files/session_recorder.hpp"
#include "proto/wire/host_process.hpp"
#include "server/access.hpp"
#include "server/host.hpp"
#include "server/options.hpp"
#include "server/service/service.hpp"
#include "server/shard/task_pool.hpp"
#include "server/store/posix_storage.hpp"
#include "server/store/store.hpp"
#include "server/transport/descriptor_guard.hpp"
#include "server/transport/router.hpp"

namespace shearbus::server {

// Receives lines for the operator; an empty function drops them.
struct Log {
  std::function<void(const std::string&)> info;
  std::function<void(const std::string&)> debug;
};

class Server {
 public:
  // Takes the state directory. Throws if it is another server's.
  explicit Server(const ServerOptions& options, const Log& log = {});
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;
  ~Server();

  // Binds an endpoint and returns it as bound, with its port if "*" was given. Throws what Router::bind() throws.
  std::string bind(const std::string& endpoint) { return router_.bind(endpoint); }

  // Recovers the contents of the state directory; called once, before run(). Meanwhile every request is refused with
  // RECOVERING. Returns false if `stop_fd` became readable before the end; nothing was changed then. Throws if the
  // directory cannot be used.
  bool recover(int stop_fd = -1, ServiceManager* manager = nullptr);

  // Answers requests until `stop_fd` is readable, or until no session is left after an operator has asked the server to
  // end with the last session. Then refuses waiting requests with SHUTTING_DOWN and writes a last checkpoint. Throws
  // std::runtime_error if the server must end at once, for example if the journal cannot be written. Notifies `manager`
  // once a second unless it is null.
  void run(int stop_fd, ServiceManager* manager = nullptr);

  // True if the time was over that an operator had given the sessions, and the server ended though some were open.
  bool ended_with_sessions() const { return ended_with_sessions_; }

  std::uint64_t epoch() const { return epoch_; }
  void* context() { return router_.context(); }
  wire::ServerStatus status() const { return service_.status(); }
  const Access& access() const { return access_; }
  const transport::RouterCounters& transport() const { return router_.counters(); }

 private:
  void checkpoint_if_due();
  void while_replaying();
  void end_if_failed() const;  // throws std::runtime_error
  service::ServiceOptions with_hooks(service::ServiceOptions options);
  void look_after();
  void look_at_sessions();
  void complete_status(wire::ServerStatus& status) const;

  std::uint64_t epoch_;
  wire::Event wake_{"no eventfd to wake the server"};
  shard::TaskPool pool_;
  std::unique_ptr<store::PosixStorage> storage_;  // null without a state directory
  std::unique_ptr<store::Store> store_;
  std::unique_ptr<files::SessionRecorder> recorder_;  // null without a directory of recordings
  service::Service service_;
  Access access_;
  transport::Router router_;
  std::uint64_t checkpoint_every_ns_;
  std::uint64_t last_checkpoint_ns_;
  std::function<void(const std::string&)> log_;
  ServiceManager* manager_ = nullptr;
  int stop_fd_ = -1;  // during a recovery
  bool ended_with_sessions_ = false;
  std::uint64_t looked_at_socket_ns_ = 0;
  std::uint64_t looked_after_ns_ = 0;
  std::uint64_t looked_at_sessions_ns_ = 0;
  bool files_run_out_ = false;        // true if the last report said that files run out
  transport::GuardCounters guarded_;  // the guard's counters in the last report
};

}  // namespace shearbus::server
