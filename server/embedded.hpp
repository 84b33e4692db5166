// The whole server on a thread of the caller's process, reached over inproc://. Programs use it if their user names no
// endpoint. It does not log. Clients share its libzmq context and must be destroyed before it.
#pragma once

#include <memory>
#include <string>

#include "server/options.hpp"

namespace shearbus::server {

class Embedded {
 public:
  explicit Embedded(const ServerOptions& options = {});  // options.endpoints is ignored
  Embedded(Embedded&&) noexcept;
  Embedded& operator=(Embedded&&) noexcept;
  ~Embedded();  // completes the request in progress, then stops the server

  const std::string& endpoint() const;  // "inproc://..."
  void* context() const;                // the libzmq context that clients must use

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::server
