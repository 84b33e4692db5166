// A server in this process, from libshearbus-embedded.so, which is loaded when the first server starts.
#pragma once

#include <string>

#include "server/embedded_library.hpp"

namespace shearbus {

class EmbeddedServer {
 public:
  // Throws Error{kUnreachable} if the library cannot be loaded or the server cannot start.
  EmbeddedServer(const std::string& state_dir, unsigned threads);
  EmbeddedServer(const EmbeddedServer&) = delete;
  EmbeddedServer& operator=(const EmbeddedServer&) = delete;
  ~EmbeddedServer();  // runs after the clients of this server are destroyed

  const char* endpoint() const { return server_.endpoint; }
  void* context() const { return server_.context; }

 private:
  shearbus_embedded_server server_{};
  void (*stop_)(void*) noexcept = nullptr;
};

}  // namespace shearbus
