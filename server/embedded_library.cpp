#include "server/embedded_library.hpp"

#include <cstdio>
#include <exception>
#include <memory>

#include "server/embedded.hpp"
#include "server/store/checkpoint_library.hpp"

using shearbus::server::Embedded;

bool shearbus_embedded_start_1(const char* state_dir, unsigned threads, shearbus_embedded_server* started, char* error,
                               std::size_t error_bytes) noexcept try {
  shearbus::server::ServerOptions options;
  options.state_dir = state_dir;
  options.threads = threads;
  // Loads the library that writes checkpoints, so that a missing library is an error now.
  if (!options.state_dir.empty()) shearbus::store::checkpoint_library();
  auto server = std::make_unique<Embedded>(options);
  *started = {.server = server.get(), .context = server->context(), .endpoint = server->endpoint().c_str()};
  static_cast<void>(server.release());
  return true;
} catch (const std::exception& fault) {
  static_cast<void>(std::snprintf(error, error_bytes, "%s", fault.what()));
  return false;
}

void shearbus_embedded_stop_1(void* server) noexcept {
  delete static_cast<Embedded*>(server);
}
