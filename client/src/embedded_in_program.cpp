// EmbeddedServer for a program that has the server linked into it, and so needs no library to load.
#include <stdexcept>

#include "client/src/embedded_server.hpp"
#include "proto/wire/status.hpp"
#include "server/embedded.hpp"

namespace shearbus {

EmbeddedServer::EmbeddedServer(const std::string& state_dir, unsigned threads) try {
  server::ServerOptions options;
  options.state_dir = state_dir;
  options.threads = threads;
  auto server = std::make_unique<server::Embedded>(options);
  server_ = {.server = server.get(), .context = server->context(), .endpoint = server->endpoint().c_str()};
  stop_ = [](void* handle) noexcept { delete static_cast<server::Embedded*>(handle); };
  static_cast<void>(server.release());
} catch (const wire::Error&) {
  throw;
} catch (const std::exception& fault) {
  throw wire::Error(
      {.code = wire::Code::kUnreachable, .text = std::string("the embedded server did not start: ") + fault.what()});
}

EmbeddedServer::~EmbeddedServer() {
  stop_(server_.server);
}

}  // namespace shearbus
