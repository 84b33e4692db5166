// What a program is: version, commit, compiler, protocol, libraries, registers; and the provenance of what it writes.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace shearbus::server {

// The commit of the sources, 12 hexadecimal digits, with "+dirty" if tracked files have been changed; "unknown" if the
// sources are no repository. Defined in a file that each build generates (deploy/cmake/commit.cmake).
extern const char* const kCommit;

using Entries = std::vector<std::pair<std::string, std::string>>;  // keys and values, in the order of their output

// Entries: program, version, commit, build, compiler, protocol, numerics, libzmq, hdf5, protobuf, registers. The
// libraries are those that the process has loaded, except protobuf, whose version is that of its headers: it loads no
// other.
Entries version_of(const std::string& program);
// The answer to --version: the entries as text whose first line is "PROGRAM VERSION", or as one line of JSON.
std::string version_text(const std::string& program, bool json);

std::string machine_name();  // empty: not known

// A word as a shell reads it: in quotes if it has anything but letters, digits and harmless marks.
std::string quoted(std::string_view word);

// Where a result comes from: program, version, commit, scene, date (UTC, ISO 8601), machine, command. `scene` is the
// name of the scene; `arguments` are those of main(), and the command is written so that a shell reads it back.
Entries provenance(const std::string& program, const std::string& scene, std::span<const char* const> arguments);
// Returns the value of a key; empty if there is no such key.
inline std::string value_of(const Entries& entries, std::string_view key) {
  for (const auto& [name, value] : entries)
    if (name == key) return value;
  return {};
}

}  // namespace shearbus::server
