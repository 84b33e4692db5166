#include "server/version.hpp"

#include <H5public.h>
#include <fmt/format.h>
#include <google/protobuf/stubs/common.h>
#include <unistd.h>
#include <zmq.h>

#include <algorithm>
#include <array>
#include <climits>
#include <nlohmann/json.hpp>
#include <string_view>

#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"
#include "server/physics/layer/registers.hpp"
#include "server/physics/numerics.hpp"

namespace shearbus::server {
namespace {

std::string zmq_version_text() {
  int major = 0, minor = 0, patch = 0;
  ::zmq_version(&major, &minor, &patch);
  return fmt::format("{}.{}.{}", major, minor, patch);
}

std::string hdf5_version_text() {
  unsigned major = 0, minor = 0, patch = 0;
  ::H5get_libversion(&major, &minor, &patch);
  return fmt::format("{}.{}.{}", major, minor, patch);
}

std::string registers_text() {
  return physics::registers_of_four ? "4 doubles (AVX2)" : "2 doubles";
}

}  // namespace

std::string machine_name() {
  std::array<char, HOST_NAME_MAX + 1> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "";
}

std::string quoted(std::string_view word) {
  const auto harmless = [](char c) {
    return wire::is_ascii_alphanumeric(c) || static_cast<unsigned char>(c) >= 0x80 ||
           std::string_view("_-+=:,./@%").find(c) != std::string_view::npos;
  };
  if (!word.empty() && std::ranges::all_of(word, harmless)) return std::string(word);
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

Entries version_of(const std::string& program) {
  return {{"program", program},
          {"version", SHEARBUS_RELEASE},
          {"commit", kCommit},
          {"build", SHEARBUS_BUILD},
          {"compiler", SHEARBUS_COMPILER},
          {"protocol", fmt::format("{}.{}", wire::kProtocolMajor, wire::kProtocolMinor)},
          {"numerics", std::to_string(physics::kNumericsVersion)},
          {"libzmq", zmq_version_text()},
          {"hdf5", hdf5_version_text()},
          {"protobuf", fmt::format("{}.{}.{}", GOOGLE_PROTOBUF_VERSION / 1'000'000,
                                   GOOGLE_PROTOBUF_VERSION / 1'000 % 1'000, GOOGLE_PROTOBUF_VERSION % 1'000)},
          {"registers", registers_text()}};
}

std::string version_text(const std::string& program, bool json) {
  const Entries entries = version_of(program);
  if (json) {
    nlohmann::ordered_json object;
    for (const auto& [key, value] : entries) object[key] = value;
    return object.dump();
  }
  std::string text = fmt::format("{} {}", program, SHEARBUS_RELEASE);
  for (std::size_t i = 2; i < entries.size(); ++i)
    text += fmt::format("\n  {:<10} {}", entries[i].first, entries[i].second);
  return text;
}

Entries provenance(const std::string& program, const std::string& scene, std::span<const char* const> arguments) {
  std::string command = program;
  for (const char* const argument : arguments.subspan(std::min<std::size_t>(1, arguments.size())))
    command += fmt::format(" {}", quoted(argument));
  return {{"program", program},      {"version", SHEARBUS_RELEASE}, {"commit", kCommit}, {"scene", scene},
          {"date", wire::utc_now()}, {"machine", machine_name()},   {"command", command}};
}

}  // namespace shearbus::server
