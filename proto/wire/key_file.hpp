// Files of CURVE keys. A key is 40 characters of Z85 (ZeroMQ RFC 32). One stands on each line, with words behind it;
// lines that begin with "# ", and empty ones, are comments. A file of a secret key holds that one only, and must be its
// owner's alone.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace shearbus::wire {

inline constexpr std::size_t kKeyCharacters = 40;

// Where a server is, and what a client shows it: what programs take as --server, --server-key and --key.
struct ServerAddress {
  std::string endpoint;    // tcp://host:port or ipc://path
  std::string server_key;  // tcp: the server's public key; empty: the connection is not encrypted
  std::string secret_key;  // of the client, with server_key
};

struct KeyLine {
  std::string key;
  std::string words;  // what stands behind it
};

bool is_key(const std::string& text);

// All throw std::runtime_error that names file and line, what was expected and what was found.
std::vector<KeyLine> read_keys(const std::filesystem::path& file);
std::string read_public_key(const std::filesystem::path& file);
std::string read_secret_key(const std::filesystem::path& file);

// Both or neither of the files; fills in the keys of an address.
void read_keys_into(ServerAddress& address, const std::filesystem::path& server_key,
                    const std::filesystem::path& secret_key);

// Never writes over a file. The secret one has mode 0600.
void write_public_key(const std::filesystem::path& file, const KeyLine& line);
void write_secret_key(const std::filesystem::path& file, const std::string& key);

}  // namespace shearbus::wire
