// An operator's connection to a server, over the interface that hosts use (shearbus/client.hpp), with answers as the
// messages of the wire.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "proto/files/key_file.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::ctl {

using wire::Code;
using wire::Error;

// The nodes of a session that rank highest. The sliding velocity is filled for Top::kFastest only.
struct TopNodes {
  wire::SessionInfo session;
  std::uint64_t matching = 0;  // number of nodes that qualify, including those beyond the ones asked for
  std::vector<std::uint64_t> node_ids;
  std::vector<double> interface_temperature_k;
  std::vector<double> shear_stress_pa;
  std::vector<double> sliding_velocity_m_per_s;
  std::vector<std::uint32_t> regime;
};

// All calls throw Error.
class Operator {
 public:
  // `once`: a request is not repeated before the deadline; a server would make a repeated checkpoint once more.
  Operator(const files::ServerAddress& server, double deadline_s, bool once);
  Operator(Operator&&) noexcept;
  Operator& operator=(Operator&&) noexcept;
  ~Operator();

  const wire::Welcome& welcome() const;
  wire::ServerStatus server_status();
  std::vector<wire::SessionInfo> sessions();
  TopNodes top_nodes(const wire::SessionId& session, wire::Top by, std::uint32_t count);
  wire::SessionClosed close(const wire::SessionInfo& session);  // as sessions() told it
  wire::Checkpointed checkpoint();
  wire::Draining drain(bool exit, std::uint64_t within_s);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// What the server says of a scene, of which it opens a session in this process.
struct CheckedScene {
  std::string effective_scene;
  std::vector<std::string> warnings;
  std::uint64_t bytes_per_node = 0;
};
CheckedScene check_scene(const std::string& text, const std::string& file);

struct KeyPair {  // of CURVE, each of 40 characters
  std::string public_key, secret_key;
};
KeyPair make_key_pair();

}  // namespace shearbus::ctl
