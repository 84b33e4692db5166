// The whole server on a thread of the caller's process, reached over inproc://; used if no endpoint is named. It does
// not log. Clients share its context and must be destroyed before it.
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
  ~Embedded();  // completes the request in progress, then stops

  const std::string& endpoint() const;  // "inproc://..."
  void* context() const;                // the libzmq context shared with the clients

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::server
