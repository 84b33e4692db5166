// The rooms put together, bottom room first. The program and the embedded server both are this and a way to stop it.
#pragma once

#include <functional>
#include <string>

#include "server/options.hpp"
#include "server/service/service.hpp"
#include "server/shard/task_pool.hpp"
#include "server/transport/router.hpp"

namespace shearbus::server {

// Where lines for people go; an empty one drops them.
struct Log {
  std::function<void(const std::string&)> info;
  std::function<void(const std::string&)> debug;
};

class Server {
 public:
  explicit Server(const ServerOptions& options, const Log& log = {});

  // As Router::bind.
  std::string bind(const std::string& endpoint) { return router_.bind(endpoint); }

  // Answers until `stop_fd` is readable; what waits by then is refused with SHUTTING_DOWN.
  void run(int stop_fd);

  void* context() { return router_.context(); }
  wire::ServerStatus status() const { return service_.status(); }
  const transport::RouterCounters& transport() const { return router_.counters(); }

 private:
  shard::TaskPool pool_;
  service::Service service_;
  transport::Router router_;
};

}  // namespace shearbus::server
