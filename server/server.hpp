// The rooms put together, bottom room first. The program and the embedded server both are this and a way to stop it.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "server/access.hpp"
#include "server/host.hpp"
#include "server/options.hpp"
#include "server/service/service.hpp"
#include "server/shard/task_pool.hpp"
#include "server/store/posix_storage.hpp"
#include "server/store/store.hpp"
#include "server/transport/router.hpp"

namespace shearbus::server {

// Where lines for people go; an empty one drops them.
struct Log {
  std::function<void(const std::string&)> info;
  std::function<void(const std::string&)> debug;
};

class Server {
 public:
  // Takes up what the state directory holds. Throws where that cannot be used.
  explicit Server(const ServerOptions& options, const Log& log = {});

  // As Router::bind.
  std::string bind(const std::string& endpoint) { return router_.bind(endpoint); }

  // Answers until `stop_fd` is readable; what waits by then is refused with SHUTTING_DOWN, and a last checkpoint is
  // written. Throws std::runtime_error where the server must end at once, as after a journal that cannot be written.
  // Where it was drained to its end it stops by itself. The manager, if there is one, is told that the loop turns.
  void run(int stop_fd, ServiceManager* manager = nullptr);

  void* context() { return router_.context(); }
  wire::ServerStatus status() const { return service_.status(); }
  const Access& access() const { return access_; }
  const transport::RouterCounters& transport() const { return router_.counters(); }

 private:
  Server(const ServerOptions& options, const Log& log, std::uint64_t epoch);
  void checkpoint_if_due();
  service::ServiceOptions with_hooks(service::ServiceOptions options);
  void look_after();
  void complete_status(wire::ServerStatus& status) const;

  shard::TaskPool pool_;
  std::unique_ptr<store::PosixStorage> storage_;  // null without a state directory
  std::unique_ptr<store::Store> store_;
  service::Service service_;
  Access access_;
  transport::Router router_;
  std::uint64_t checkpoint_every_ns_;
  std::uint64_t last_checkpoint_ns_;
  std::function<void(const std::string&)> log_;
  ServiceManager* manager_ = nullptr;
  std::uint64_t looked_after_ns_ = 0;
  bool files_run_out_ = false;  // as it was last told
};

}  // namespace shearbus::server
