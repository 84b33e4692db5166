// Endpoint files: a server that listens writes its address and its public key into a file, and clients read the file
// instead of being given both. deploy/README.md, "Endpoint files", describes the format.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "proto/files/whole_file.hpp"

namespace shearbus::files {

// Begin of an endpoint that names an endpoint file: file://PATH.
inline constexpr std::string_view kFileScheme = "file://";

struct EndpointFile {
  std::string version;     // of the server program
  std::string host;        // name of the server's machine
  std::string server_key;  // the server's public key; empty: the server has none
  std::string endpoint;    // address for clients: tcp://HOST:PORT or ipc://PATH
  std::string epoch;       // 16 hexadecimal digits, others for each start of a server
};

// Returns the address for clients of an endpoint as bound. A tcp address of all interfaces becomes one of `host`, a
// relative ipc path an absolute one.
std::string address_for_clients(const std::string& bound, const std::string& host);

// Returns the text of an endpoint file. Throws std::runtime_error for a value that the format cannot hold.
std::string text_of(const EndpointFile& contents);

// An endpoint file as an output; also one that was written only in part.
extern const FileKind kEndpointFile;

// Throws std::runtime_error for a file that is absent, incomplete or no endpoint file; its text names the file.
EndpointFile read_endpoint_file(const std::filesystem::path& file);

// Returns false for what no server makes an endpoint file of: a file of another kind, which no server replaces.
bool may_become_endpoint_file(const std::filesystem::path& file);

// Returns the endpoint files in a directory, told by their contents, ordered by their names. Throws std::runtime_error
// if it has none or cannot be read.
std::vector<std::filesystem::path> endpoint_files(const std::filesystem::path& directory);

// Throws wire::Error if a server that runs has written the file.
void refuse_file_of_running_server(const std::filesystem::path& file);

// The endpoint file of a server, there and locked as long as this object. A file that was replaced since is left there.
class PublishedEndpoint {
 public:
  // Throws wire::Error for a file that cannot be written, or that is of a server that runs.
  PublishedEndpoint(const std::filesystem::path& file, const EndpointFile& contents);
  ~PublishedEndpoint();

 private:
  std::filesystem::path file_;
  std::string text_;
  wire::Descriptor lock_;
};

}  // namespace shearbus::files
