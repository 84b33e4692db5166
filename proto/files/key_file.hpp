// Files of CURVE keys. A key is 40 characters of Z85 (ZeroMQ RFC 32). Each line holds one key, followed by words; empty
// lines and lines that begin with "# " are comments. A file of a secret key holds only that key, and only its owner may
// read the file.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace shearbus::files {

inline constexpr std::size_t kKeyCharacters = 40;

// Address of a server and keys of the connection: the options --server, --server-key and --key of programs.
struct ServerAddress {
  std::string endpoint;                          // tcp://host:port, ipc://path, or file://path of an endpoint file
  std::string server_key;                        // tcp: the server's public key; empty: the connection is not encrypted
  std::string secret_key;                        // tcp: secret key of the client; empty if server_key is empty
  std::string server_key_file, secret_key_file;  // where the keys were read; empty: nowhere
};

struct KeyLine {
  std::string key;
  std::string words;  // the words that follow the key on its line
};

bool is_key(const std::string& text);

// These functions throw std::runtime_error. Its text names the file and, for a line that is no key, the line and the
// expected text.
std::vector<KeyLine> read_keys(const std::filesystem::path& file);
std::string read_public_key(const std::filesystem::path& file);
std::string read_secret_key(const std::filesystem::path& file);

// Says what is wrong with giving one of the two key files of an address, or returns an empty text.
std::string fault_of_keys(const ServerAddress& address, const std::filesystem::path& server_key,
                          const std::filesystem::path& secret_key);
// Reads the two key files of an address; either both files or neither must be given. An endpoint file holds the
// server's key itself.
void read_keys_into(ServerAddress& address, const std::filesystem::path& server_key,
                    const std::filesystem::path& secret_key);

// Writes a pair of key files, the secret one with mode 0600. Never overwrites a file.
void write_public_key(const std::filesystem::path& file, const KeyLine& line);
void write_secret_key(const std::filesystem::path& file, const std::string& key);

}  // namespace shearbus::files
