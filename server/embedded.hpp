// The whole server on a thread of the caller's process, reached over inproc://: what runs when a user names no
// endpoint. It logs nothing. Clients share its context, so they must be gone before it: declare it first.
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
  ~Embedded();  // answers what is being computed, then stops

  const std::string& endpoint() const;  // "inproc://..."
  void* context() const;                // the libzmq context both ends share

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::server
