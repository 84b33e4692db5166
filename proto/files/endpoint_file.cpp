#include "proto/files/endpoint_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <stdexcept>
#include <utility>

#include "proto/files/input_file.hpp"
#include "proto/files/key_file.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::files {
namespace {

constexpr std::size_t kMaxFileBytes = 4096;

struct Key {
  std::string_view name;
  std::string EndpointFile::*value;
};
// All keys are required, so that a file without its last lines is known to be incomplete.
constexpr std::array<Key, 5> kKeys = {{{"version", &EndpointFile::version},
                                       {"host", &EndpointFile::host},
                                       {"server_key", &EndpointFile::server_key},
                                       {"endpoint", &EndpointFile::endpoint},
                                       {"epoch", &EndpointFile::epoch}}};

constexpr const char* kFirstLine = "# The server writes this file when it listens and removes it when it ends.\n";

[[noreturn]] void refuse(const std::filesystem::path& file, const std::string& fault) {
  throw std::runtime_error(fmt::format("{}: {}", file.string(), fault));
}

std::string read_small(const std::filesystem::path& file) try {
  std::string text = RegularFile(file).head(kMaxFileBytes + 1);
  if (text.size() > kMaxFileBytes)
    refuse(file, fmt::format("has more than {} bytes; it is no endpoint file", kMaxFileBytes));
  return text;
} catch (const wire::Error& fault) {
  throw std::runtime_error(fault.status().text);
}

bool can_stand_in_quotes(const std::string& value) {
  return std::none_of(value.begin(), value.end(),
                      [](unsigned char c) { return c == '"' || c == '\\' || c < 0x20 || c == 0x7f; });
}

// Returns key and value of a line `key = "value"`.
std::pair<std::string_view, std::string_view> parts_of(std::string_view line) {
  constexpr std::string_view kBetween = " = \"";
  const std::size_t at = line.find(kBetween);
  if (at == std::string_view::npos || !line.ends_with('"') || line.size() < at + kBetween.size() + 1) return {};
  return {line.substr(0, at), line.substr(at + kBetween.size(), line.size() - at - kBetween.size() - 1)};
}

bool is_endpoint_file(const std::filesystem::path& file) {
  if (head_of(file, kMaxFileBytes).starts_with(kFirstLine)) return true;
  try {
    read_endpoint_file(file);
    return true;
  } catch (const std::runtime_error&) {
    return false;
  }
}

}  // namespace

const FileKind kEndpointFile = {"an endpoint file of shearbus-server", is_endpoint_file};

std::string address_for_clients(const std::string& bound, const std::string& host) {
  constexpr std::string_view kIpc = "ipc://";
  if (bound.starts_with(kIpc))
    return std::string(kIpc) + std::filesystem::absolute(bound.substr(kIpc.size())).lexically_normal().string();
  for (const std::string_view all : {"tcp://0.0.0.0:", "tcp://[::]:", "tcp://*:"})
    if (bound.starts_with(all)) return fmt::format("tcp://{}:{}", host, bound.substr(all.size()));
  return bound;
}

std::string text_of(const EndpointFile& contents) {
  std::string text = kFirstLine;
  for (const Key& key : kKeys) {
    const std::string& value = contents.*key.value;
    if (!can_stand_in_quotes(value))
      throw std::runtime_error(
          fmt::format("the {} \"{}\" has a character that an endpoint file cannot hold", key.name, value));
    text += fmt::format("{} = \"{}\"\n", key.name, value);
  }
  return text;
}

EndpointFile read_endpoint_file(const std::filesystem::path& file) {
  const std::string text = read_small(file);
  EndpointFile contents;
  std::array<bool, kKeys.size()> found{};
  std::string_view rest = text;
  for (std::size_t number = 1; !rest.empty(); ++number) {
    const std::size_t end = rest.find('\n');
    if (end == std::string_view::npos)
      refuse(file, fmt::format("line {} is incomplete; the file was written only in part", number));
    const std::string_view line = rest.substr(0, end);
    rest.remove_prefix(end + 1);
    if (line.empty() || line.starts_with('#')) continue;
    const auto [name, value] = parts_of(line);
    if (name.empty() || !can_stand_in_quotes(std::string(value)))
      refuse(file, fmt::format("line {}: expected key = \"value\", with printable characters", number));
    for (std::size_t i = 0; i < kKeys.size(); ++i)
      if (kKeys[i].name == name) {
        contents.*kKeys[i].value = value;
        found[i] = true;
      }
  }
  for (std::size_t i = 0; i < kKeys.size(); ++i)
    if (!found[i])
      refuse(file, fmt::format("has no {}; expected an endpoint file of shearbus-server, complete", kKeys[i].name));
  if (!contents.endpoint.starts_with("tcp://") && !contents.endpoint.starts_with("ipc://"))
    refuse(file, fmt::format("endpoint = \"{}\", expected tcp://HOST:PORT or ipc://PATH", contents.endpoint));
  if (!contents.server_key.empty() && !is_key(contents.server_key))
    refuse(file, fmt::format("server_key is not a key of {} characters of Z85", kKeyCharacters));
  return contents;
}

std::vector<std::filesystem::path> endpoint_files(const std::filesystem::path& directory) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(directory))
    if (entry.is_regular_file() && entry.path().extension() != ".partial" && is_endpoint_file(entry.path()))
      files.push_back(entry.path());
  if (files.empty()) throw std::runtime_error(directory.string() + ": has no endpoint files; is a server running?");
  std::sort(files.begin(), files.end());
  return files;
}

bool may_become_endpoint_file(const std::filesystem::path& file) {
  std::error_code fault;
  const std::filesystem::file_status status = std::filesystem::status(file, fault);
  if (!std::filesystem::exists(status)) return true;
  if (!std::filesystem::is_regular_file(status)) return false;
  return std::filesystem::file_size(file, fault) == 0 || fault || is_endpoint_file(file);
}

void refuse_file_of_running_server(const std::filesystem::path& file) {
  const std::filesystem::path target = target_of_output(file);
  const wire::Descriptor there(::open(target.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY | O_NOFOLLOW));
  if (there < 0 || ::flock(there, LOCK_SH | LOCK_NB) == 0 || errno != EWOULDBLOCK) return;
  std::string place;
  try {
    place = fmt::format(", at {}", read_endpoint_file(target).endpoint);
  } catch (const std::runtime_error&) {  // it has just ended, or the file was written over
  }
  throw wire::Error(
      {.code = wire::Code::kInvalidValue,
       .text = fmt::format("{} is the endpoint file of a server that runs{}; expected a file of this server's own",
                           file.string(), place),
       .remedy = "Stop that server first, or name another file."});
}

PublishedEndpoint::PublishedEndpoint(const std::filesystem::path& file, const EndpointFile& contents)
    : file_(target_of_output(file)), text_(text_of(contents)) {
  refuse_file_of_running_server(file);
  lock_ = write_whole_locked(file_, kEndpointFile, text_);
}

PublishedEndpoint::~PublishedEndpoint() {
  std::error_code ignored;
  if (std::filesystem::symlink_status(file_, ignored).type() == std::filesystem::file_type::regular &&
      head_of(file_, text_.size() + 1) == text_)
    ::unlink(file_.c_str());
}

}  // namespace shearbus::files
