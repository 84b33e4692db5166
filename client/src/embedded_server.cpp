#include "client/src/embedded_server.hpp"

#include <dlfcn.h>
#include <fmt/format.h>

#include <array>
#include <filesystem>
#include <stdexcept>

#include "proto/wire/host_process.hpp"
#include "proto/wire/status.hpp"

namespace shearbus {
namespace {

constexpr const char* kLibrary = "libshearbus-embedded.so.1";
constexpr int kMode = RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE;

[[noreturn]] void refuse(std::string text, std::string remedy) {
  throw wire::Error({.code = wire::Code::kUnreachable, .text = std::move(text), .remedy = std::move(remedy)});
}

// Loads the embedded server from the directory of this library, else from the loader's path. Uses a library of this
// name that the process has loaded already, because libprotobuf ends a process in which two copies register the same
// messages.
void* load() {
  if (void* loaded = ::dlopen(kLibrary, kMode | RTLD_NOLOAD)) return loaded;
  Dl_info self{};
  if (::dladdr(reinterpret_cast<void*>(&load), &self) != 0 && self.dli_fname != nullptr) {
    const auto neighbour = std::filesystem::path(self.dli_fname).parent_path() / kLibrary;
    std::error_code ignored;
    if (std::filesystem::exists(neighbour, ignored)) {
      if (void* loaded = ::dlopen(neighbour.c_str(), kMode)) return loaded;
      refuse(fmt::format("{} cannot be loaded: {}", neighbour.string(), ::dlerror()), "Is the installation complete?");
    }
  }
  if (void* loaded = ::dlopen(kLibrary, kMode)) return loaded;
  refuse(
      fmt::format("no server can run in this process: {}", ::dlerror()),
      "Install the component `runtime` with the embedded server, or give the endpoint of a running shearbus-server.");
}

template <typename Function>
Function entry(void* library, const char* name) {
  if (void* found = ::dlsym(library, name)) return reinterpret_cast<Function>(found);
  refuse(fmt::format("{} has no {}: it is of another version than this client library", kLibrary, name),
         "Use the libraries of one version of shearbus in a process.");
}

}  // namespace

EmbeddedServer::EmbeddedServer(const std::string& state_dir, unsigned threads) {
  try {
    wire::check_room_for_sockets();
  } catch (const std::runtime_error& fault) {
    refuse(fmt::format("no server can run in this process: {}", fault.what()), {});
  }
  void* library = load();
  const auto start = entry<decltype(&shearbus_embedded_start_1)>(library, "shearbus_embedded_start_1");
  stop_ = entry<decltype(&shearbus_embedded_stop_1)>(library, "shearbus_embedded_stop_1");
  std::array<char, 1024> error{};
  if (!start(state_dir.c_str(), threads, &server_, error.data(), error.size()))
    refuse(fmt::format("the embedded server did not start: {}", error.data()), {});
}

EmbeddedServer::~EmbeddedServer() {
  stop_(server_.server);
}

}  // namespace shearbus
