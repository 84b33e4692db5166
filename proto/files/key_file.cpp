#include "proto/files/key_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <string_view>

#include "proto/files/endpoint_file.hpp"
#include "proto/wire/handle.hpp"

namespace shearbus::files {
namespace {

constexpr std::string_view kSecretComment = "# secret key";  // how the file of one begins
constexpr std::size_t kMaxKeyFileBytes = std::size_t{4} << 20;
constexpr std::string_view kZ85 =
    "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.-:+=^!/*?&<>()[]{}@%$#";

template <typename... Arguments>
[[noreturn]] void refuse(const std::filesystem::path& file, fmt::format_string<Arguments...> text,
                         Arguments&&... arguments) {
  throw std::runtime_error(
      fmt::format("{}: {}", file.string(), fmt::format(text, std::forward<Arguments>(arguments)...)));
}

wire::Descriptor open(const std::filesystem::path& file, int flags, mode_t mode = 0) {
  wire::Descriptor opened(::open(file.c_str(), flags | O_CLOEXEC, mode));
  if (opened >= 0) return opened;
  if (errno == EEXIST) refuse(file, "exists already, and keys are never written over; name another file");
  refuse(file, "cannot be opened: {}", std::strerror(errno));
}

std::string text_of(const std::filesystem::path& file, struct stat& found) {
  const wire::Descriptor opened = open(file, O_RDONLY);
  if (::fstat(opened, &found) != 0) refuse(file, "cannot be looked at: {}", std::strerror(errno));
  std::string text(kMaxKeyFileBytes + 1, '\0');
  std::size_t size = 0;
  ssize_t taken = 0;
  while (size < text.size() && (taken = ::read(opened, text.data() + size, text.size() - size)) > 0)
    size += static_cast<std::size_t>(taken);
  if (taken < 0) refuse(file, "cannot be read: {}", std::strerror(errno));
  if (size > kMaxKeyFileBytes) refuse(file, "has more than {} bytes, which is no file of keys", kMaxKeyFileBytes);
  text.resize(size);
  return text;
}

// The other file of a pair is recognised by what it is written with: a comment, or words behind the key.
std::vector<KeyLine> keys_of(const std::filesystem::path& file, bool secret) {
  struct stat found {};
  const std::string all = text_of(file, found);
  std::string_view text = all;
  std::vector<KeyLine> lines;
  if (!secret && text.starts_with(kSecretComment))
    refuse(file, "has a secret key, expected public ones; name NAME.public of the pair");
  for (std::size_t number = 1; !text.empty(); ++number) {
    std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(line.size() + 1, text.size()));
    constexpr const char* kBlank = " \t\r";
    const auto last = line.find_last_not_of(kBlank);
    line = line.substr(0, last == std::string_view::npos ? 0 : last + 1);
    if (line.empty() || line == "#" || line.starts_with("# ")) continue;  // a key may begin with #, but has no blank
    const std::string key(line.substr(0, line.find_first_of(kBlank)));
    if (!is_key(key)) {
      if (secret) refuse(file, "line {}: expected a secret key of {} characters of Z85", number, kKeyCharacters);
      refuse(file, "line {}: expected a key of {} characters of Z85, found \"{}\" ({}); comments begin with \"# \"",
             number, kKeyCharacters, key.substr(0, 2 * kKeyCharacters), key.size());
    }
    const auto words = line.find_first_not_of(kBlank, key.size());
    if (secret && words != std::string_view::npos)
      refuse(file, "line {}: has a public key, expected the secret one; name NAME.secret of the pair", number);
    lines.push_back({key, std::string(words == std::string_view::npos ? "" : line.substr(words))});
  }
  if (secret && found.st_uid != ::geteuid() && found.st_uid != 0)
    refuse(file, "belongs to uid {}, who knows the secret key; expected root or uid {}. chown it, or make a new key",
           found.st_uid, ::geteuid());
  if (secret && (found.st_mode & 077) != 0)
    refuse(file, "has mode {:04o}: others can read the secret key; expected 0600. chmod 600 it, or make a new key",
           found.st_mode & 07777);
  return lines;
}

std::string only_key(const std::filesystem::path& file, bool secret) {
  const auto lines = keys_of(file, secret);
  if (lines.size() != 1)
    refuse(file, "has {} keys, expected one; shearbus-ctl keygen makes a pair of files", lines.size());
  return lines[0].key;
}

void write(const std::filesystem::path& file, const std::string& text, mode_t mode) {
  const wire::Descriptor opened = open(file, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW, mode);
  const ssize_t written = ::write(opened, text.data(), text.size());
  if (written != static_cast<ssize_t>(text.size()) || ::fsync(opened) != 0) {
    const int fault = written >= 0 && written != static_cast<ssize_t>(text.size()) ? ENOSPC : errno;
    ::unlink(file.c_str());
    refuse(file, "cannot be written: {}", std::strerror(fault));
  }
}

}  // namespace

bool is_key(const std::string& text) {
  return text.size() == kKeyCharacters &&
         std::all_of(text.begin(), text.end(), [](char c) { return kZ85.find(c) != std::string_view::npos; });
}

std::vector<KeyLine> read_keys(const std::filesystem::path& file) {
  return keys_of(file, false);
}
std::string read_public_key(const std::filesystem::path& file) {
  return only_key(file, false);
}
std::string read_secret_key(const std::filesystem::path& file) {
  return only_key(file, true);
}

std::string fault_of_keys(const ServerAddress& address, const std::filesystem::path& server_key,
                          const std::filesystem::path& secret_key) {
  const bool key_in_file = address.endpoint.starts_with(kFileScheme) && server_key.empty();
  return server_key.empty() == secret_key.empty() || key_in_file
             ? ""
             : "--server-key and --key go together: the server's public key and one's own secret key";
}

void read_keys_into(ServerAddress& address, const std::filesystem::path& server_key,
                    const std::filesystem::path& secret_key) {
  if (const std::string fault = fault_of_keys(address, server_key, secret_key); !fault.empty())
    throw std::runtime_error(fault);
  address.server_key_file = server_key.string();
  address.secret_key_file = secret_key.string();
  if (!server_key.empty()) address.server_key = read_public_key(server_key);
  if (!secret_key.empty()) address.secret_key = read_secret_key(secret_key);
}

void write_public_key(const std::filesystem::path& file, const KeyLine& line) {
  write(file, line.key + (line.words.empty() ? "" : " " + line.words) + "\n", 0644);
}
void write_secret_key(const std::filesystem::path& file, const std::string& key) {
  write(file, std::string(kSecretComment) + ": whoever reads it can pass for its owner\n" + key + "\n", 0600);
}

}  // namespace shearbus::files
