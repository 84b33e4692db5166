// An operator's connection to a server, over the interface that hosts use (shearbus/client.hpp). An answer is an object of
// JSON with the fields of its message in shearbus/v1/control.proto.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "client/include/shearbus/shearbus.h"
#include "proto/files/key_file.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::ctl {

using wire::Code;
using wire::Error;
using Json = nlohmann::ordered_json;

// A field of an answer. The library of this program gives an answer all fields of its message.
inline std::uint64_t count(const Json& answer, const char* field) {
  return answer.at(field).get<std::uint64_t>();
}
inline std::string text(const Json& answer, const char* field) {
  return answer.at(field).get<std::string>();
}
inline bool flag(const Json& answer, const char* field) {
  return answer.at(field).get<bool>();
}
// The quotient is the double nearest to the exact decimal fraction, and is therefore printed as this fraction.
inline double seconds(std::uint64_t ns) {
  return static_cast<double>(ns) / 1e9;
}
inline double seconds(const Json& answer, const char* field_ns) {
  return seconds(count(answer, field_ns));
}

// All calls throw Error.
class Operator {
 public:
  // `once`: a request is not repeated before the deadline; a server would make a repeated checkpoint once more.
  Operator(const files::ServerAddress& server, double deadline_s, bool once);

  const Json& welcome() const { return welcome_; }
  Json ask(const shearbus_question& question);
  Json ask(int what);

 private:
  struct Door;
  std::shared_ptr<Door> door_;
  Json welcome_;
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
