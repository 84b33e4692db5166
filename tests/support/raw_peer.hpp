// Peers that do not use the client library: a plain DEALER socket and a plain stream socket.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>
#include <zmq.hpp>

#include "proto/wire/codec.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::support {

class RawDealer {
 public:
  explicit RawDealer(const std::string& endpoint, int receive_hwm = 1000)
      : socket_(context_, zmq::socket_type::dealer) {
    socket_.set(zmq::sockopt::linger, 0);
    // Sending to a server that has refused the connection would block; this option limits the wait to 1 s.
    socket_.set(zmq::sockopt::sndtimeo, 1000);
    socket_.set(zmq::sockopt::rcvhwm, receive_hwm);
    socket_.connect(endpoint);
  }

  void send(const std::vector<std::string>& frames) {
    for (std::size_t i = 0; i < frames.size(); ++i)
      socket_.send(zmq::buffer(frames[i]), i + 1 < frames.size() ? zmq::send_flags::sndmore : zmq::send_flags::none);
  }
  void send(const wire::Request& request) { send(frames_of(request)); }

  static std::vector<std::string> frames_of(const wire::Request& request) {
    std::vector<std::string> frames = {wire::encode_header(request)};
    const auto payload = request.batch.bytes();
    if (!request.batch.columns().empty())
      frames.emplace_back(reinterpret_cast<const char*>(payload.data()), payload.size());
    return frames;
  }

  // Returns the frames of the next reply, or none after the time limit.
  std::vector<zmq::message_t> receive(std::chrono::milliseconds timeout = std::chrono::milliseconds(5000)) {
    socket_.set(zmq::sockopt::rcvtimeo, static_cast<int>(timeout.count()));
    std::vector<zmq::message_t> frames;
    for (bool more = true; more;) {
      zmq::message_t frame;
      if (!socket_.recv(frame)) return frames;
      more = frame.more();
      frames.push_back(std::move(frame));
    }
    return frames;
  }

  // Returns the status of the next reply, or nothing after the time limit.
  std::optional<wire::Status> receive_status(std::chrono::milliseconds timeout = std::chrono::milliseconds(5000)) {
    const auto frames = receive(timeout);
    if (frames.empty()) return std::nullopt;
    std::vector<std::span<const std::byte>> views;
    views.reserve(frames.size());
    for (const zmq::message_t& frame : frames)
      views.emplace_back(static_cast<const std::byte*>(frame.data()), frame.size());
    wire::Reply reply;
    wire::decode(views, reply);
    return reply.status;
  }

 private:
  zmq::context_t context_;
  zmq::socket_t socket_;
};

// What peers of other protocols send.
inline std::vector<std::string> stray_bytes() {
  return {
      "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
      std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", 11) + std::string(512, 'a'),   // a TLS client hello
      std::string("\x01\x00\x06\x00hello", 9),                                                   // ZMTP 1.0
      std::string("\xff\x00\x00\x00\x00\x00\x00\x00\x01\x7f\x01\x05\x00\x00\x00\x05hello", 21),  // ZMTP 2.0
      std::string(100'000, '\0'),
      std::string(100'000, '\xff'),
      "\r\n"};
}

class RawStream {
 public:
  // Connects to `endpoint`, which is tcp://127.0.0.1:PORT or ipc://PATH.
  explicit RawStream(const std::string& endpoint) {
    if (endpoint.starts_with("ipc://")) {
      file_ = ::socket(AF_UNIX, SOCK_STREAM, 0);
      sockaddr_un address{};
      address.sun_family = AF_UNIX;
      std::strncpy(address.sun_path, endpoint.c_str() + 6, sizeof address.sun_path - 1);
      connect(reinterpret_cast<const sockaddr*>(&address), sizeof address);
    } else {
      file_ = ::socket(AF_INET, SOCK_STREAM, 0);
      sockaddr_in address{};
      address.sin_family = AF_INET;
      address.sin_port = htons(static_cast<std::uint16_t>(std::stoi(endpoint.substr(endpoint.rfind(':') + 1))));
      ::inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
      connect(reinterpret_cast<const sockaddr*>(&address), sizeof address);
    }
  }
  RawStream(RawStream&& other) noexcept : file_(std::exchange(other.file_, -1)) {}
  RawStream& operator=(RawStream&&) = delete;
  ~RawStream() {
    if (file_ >= 0) ::close(file_);
  }

  // Returns false if the bytes cannot be sent, as on a connection that the server has closed.
  bool send(std::span<const char> bytes) {
    return ::send(file_, bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
  }

  // Returns true if the server closes the connection within `time`. Bytes that the server sends before are discarded.
  bool closed_within(std::chrono::milliseconds time) {
    const auto end = std::chrono::steady_clock::now() + time;
    while (std::chrono::steady_clock::now() < end) {
      pollfd item{file_, POLLIN, 0};
      if (::poll(&item, 1, 20) <= 0) continue;
      char dropped[4096];
      if (::recv(file_, dropped, sizeof dropped, 0) <= 0) return true;
    }
    return false;
  }

 private:
  void connect(const sockaddr* address, socklen_t size) {
    if (file_ < 0 || ::connect(file_, address, size) != 0) throw std::runtime_error(std::strerror(errno));
  }
  int file_ = -1;
};

}  // namespace shearbus::support
