// The service without a socket, for programs that replay requests: frames in, frames out, in the caller's thread.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "proto/wire/messages.hpp"

namespace shearbus::server {

class InProcess {
 public:
  explicit InProcess(unsigned threads = 0);  // threads that solve layers; 0: one per core
  InProcess(const InProcess&) = delete;
  InProcess& operator=(const InProcess&) = delete;
  ~InProcess();

  struct Answer {
    std::string header;
    std::span<const std::byte> payload;
    std::shared_ptr<const void> owner;  // keeps the payload
  };
  // Throws std::runtime_error if the service has no memory for the answer.
  Answer answer(std::span<const std::byte> header, std::optional<std::span<const std::byte>> payload);

  // Continues a session under another scene, with its states, marks and trial. Throws wire::Error for a scene at fault,
  // std::invalid_argument for a scene whose layers have other states.
  void change_scene(const wire::SessionId& session, const std::string& scene, const std::string& scene_file);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::server
