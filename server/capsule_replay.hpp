// Repeats the step that a failure capsule records. The capsule is a file about one node without an answer; the node is
// stepped alone, without a server.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace shearbus::server {

struct CapsuleReplay {
  struct Part {  // a part of the node's state before the step
    std::string name, units;
    std::size_t values = 0;
    std::size_t not_finite = 0;
    double lowest = 0.0, highest = 0.0;  // smallest and largest finite value of the part
  };
  struct Column {
    std::string name;
    double recorded = 0.0;
    double found = 0.0;
    bool same = false;  // true if `recorded` and `found` agree to the last bit
  };
  std::string server_version;
  std::uint64_t node_id = 0, sequence = 0, step = 0, attempt = 0;
  double dt_s = 0.0, time_s = 0.0;
  std::string scene;
  std::vector<Part> state;
  std::vector<std::pair<std::string, double>> inputs;
  std::vector<Column> answer;

  bool same() const;
};

// Throws std::runtime_error if the file cannot be read.
CapsuleReplay replay_capsule(const std::filesystem::path& file);

}  // namespace shearbus::server
