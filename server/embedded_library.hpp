// The entry points of libshearbus-embedded.so: server::Embedded behind C functions, so that the client library can load
// it on demand. They are private to the libraries of this project. The number in their names rises with any change, so
// a client library never calls the entry points of another version.
#pragma once

#include <cstddef>

extern "C" {

struct shearbus_embedded_server {  // what a client needs to reach the server
  void* server;                    // handle for shearbus_embedded_stop_1
  void* context;                   // libzmq context that clients must use
  const char* endpoint;            // "inproc://..."
};

// Starts a server on a thread of this process. state_dir: directory of its states, or empty. Returns true; or false,
// with the reason in `error`.
__attribute__((visibility("default"))) bool shearbus_embedded_start_1(const char* state_dir, unsigned threads,
                                                                      shearbus_embedded_server* started, char* error,
                                                                      std::size_t error_bytes) noexcept;
// Completes the request in progress and stops the server. All clients must have ended.
__attribute__((visibility("default"))) void shearbus_embedded_stop_1(void* server) noexcept;
}
