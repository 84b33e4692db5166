// What the programs of this project put between shearbus/client.hpp, by which they reach a server as any host does, and
// the values of proto/wire that they work with.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <shearbus/client.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "proto/files/key_file.hpp"
#include "proto/wire/batch.hpp"
#include "proto/wire/status.hpp"

namespace shearbus {

// Calls what asks the service, and throws its refusal as the wire::Error that programs print.
template <typename Ask>
auto asking(const Ask& ask) -> decltype(ask()) {
  try {
    return ask();
  } catch (const Error& fault) {
    throw wire::Error({.code = static_cast<wire::Code>(fault.code()),
                       .text = fault.text(),
                       .remedy = fault.remedy(),
                       .field = fault.field(),
                       .node_ids = fault.nodes()});
  }
}

// The options of a program whose command line decides, whatever the environment says.
inline Options options_of(const std::string& program, const files::ServerAddress& server) {
  Options options;
  options.name = program;
  options.endpoint = server.endpoint;
  options.server_key_file = server.server_key_file;
  options.secret_key_file = server.secret_key_file;
  options.ignore_environment = true;
  return options;
}

inline std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

// Whether a line of the log is about an opening, of which the program tells itself.
inline bool is_about_opening(const std::string& line) {
  const auto begins = [&](const char* with) { return line.starts_with(with); };
  return std::ranges::any_of(std::array{"session of ", "note: ", "warning: "}, begins);
}

// The rows of profiles: the columns that the scene has, vertex after vertex.
inline wire::Batch rows_of(const Profiles& profiles, std::uint32_t tangential_components) {
  std::vector<wire::Field> fields;
  for (const Profiles::Column& column : profiles.columns)
    if (column.component == 0 && !std::ranges::all_of(column.values, [](double value) { return std::isnan(value); }))
      fields.push_back(static_cast<wire::Field>(column.field));
  wire::Batch rows = wire::Batch::of(fields, profiles.nodes * profiles.vertices, tangential_components);
  for (const wire::Column& column : rows.columns())
    std::ranges::copy(profiles(static_cast<std::uint32_t>(column.field), column.component),
                      rows.f64(column.field, column.component).begin());
  return rows;
}

// Closes a session that ends with its program, without a long wait for a server that may be gone.
inline void close_soon(Session& session) noexcept {
  constexpr double kDeadlineS = 1.0;
  try {
    session.set_reply_deadline(kDeadlineS);
    session.close();
  } catch (const std::exception&) {
    // The server is gone, or closes the session when it ends.
  }
}

}  // namespace shearbus
