// A session of a replay, over the interface that hosts use (shearbus/client.hpp). Requests and answers are batches of
// columns, which a history fills and a result keeps.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "client/include/shearbus/shearbus.h"
#include "client/replay/node_properties.hpp"
#include "proto/files/key_file.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::replay {

struct Answer {
  Batch columns;  // one value per node
  shearbus_result result = SHEARBUS_RESULT_INIT;
};

class Bus {
 public:
  // Opens a session of a scene, which `scene_file` names in messages. Without an endpoint the server runs in this
  // process. All calls throw wire::Error.
  Bus(const files::ServerAddress& server, const std::string& scene, const std::string& scene_file,
      std::span<const std::uint64_t> node_ids, const NodeProperties& properties);
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;
  ~Bus();  // closes a session that is still open

  const wire::SessionOpened& opened() const;  // scene, strategy and columns of a step
  const std::string& server_version() const;

  // Zeroed columns of a step of all nodes: those that it needs in this form, and the optional ones that are given.
  Batch request(std::span<const Field> optional_columns, Form form) const;
  void want_energy_ledger();  // in the later answers, if the session has it
  const Answer& advance(const Batch& request, double dt_s, double time_s, std::uint64_t step);
  // The rows of the profiles of some nodes: the columns that the scene has, vertex after vertex.
  Batch profiles(std::span<const std::uint64_t> node_ids, const std::vector<double>& pressure_pa = {});
  wire::SessionClosed close();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::replay
