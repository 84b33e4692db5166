// Internal to the C interface: the options of an opening, with what the environment of the process puts in their place.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "client/include/shearbus/shearbus.h"
#include "client/src/embedded_server.hpp"
#include "client/src/options.hpp"

namespace shearbus {

std::string environment(const char* name);  // "" for a variable that is not set
// The same, and "" for options that ignore the environment.
std::string environment(const shearbus_options& options, const char* name);
std::string in_message(std::string_view text);  // a text of the host: on one line, without commands to a terminal
// Reads bytes from twice as many hexadecimal digits; false for anything else.
bool from_hex(std::string_view digits, std::span<std::uint8_t> bytes);

// Writes log lines of a session to the host's callback and to the file that SHEARBUS_LOG names.
class LineLog {
 public:
  LineLog() = default;
  LineLog(shearbus_log_fn function, void* user, std::string file);

  bool wanted() const { return function_ != nullptr || !file_.empty(); }
  void operator()(const std::string& line) const;

 private:
  shearbus_log_fn function_ = nullptr;
  void* user_ = nullptr;
  std::string file_;
};

struct Scene {
  std::string text;
  std::string name;  // name of the scene in messages
};
Scene scene_of(const shearbus_options& options);

// A time of the caller; 0 stands for the default. Throws Error for any other that is not from above 0 to 1e7 s.
std::chrono::milliseconds seconds(double value, std::chrono::milliseconds otherwise, const char* name);

std::string endpoint_of(const shearbus_options& options);
bool is_embedded(const std::string& endpoint);  // names no server of another process
// A fault of an opening, with the variable of the environment that gave the option at fault, if one did.
Error naming_variable(Status status, const shearbus_options* options);
// The server in this process, if the endpoint names none. Throws Error for options that do not go with the endpoint.
void embed(const shearbus_options& options, const std::string& endpoint, std::optional<EmbeddedServer>& embedded);
ClientOptions client_options(const shearbus_options& options, const std::string& endpoint,
                             const std::optional<EmbeddedServer>& embedded, const LineLog& log);

}  // namespace shearbus
