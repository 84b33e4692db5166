// Every option of the server: default and a sentence each. main.cpp reads them from the command line.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace shearbus::server {

struct ServerOptions {
  std::vector<std::string> endpoints;       // where to listen: tcp://address:port or ipc://path, any number
  unsigned threads = 0;                     // that solve layers, the socket's own included; 0: one per core
  std::size_t nodes_per_task = 512;         // batches below this are answered on the socket's thread
  std::uint64_t max_state_bytes = 0;        // of the states of all sessions; 0: three quarters of the machine's memory
  std::string state_dir;                    // where sessions outlive the server; empty: they do not
  std::string durability = "process";       // of a reply, with state_dir: none, process or power (store.hpp)
  double checkpoint_every_s = 600.0;        // where anything has changed; the journal since is replayed at a start
  std::uint64_t checkpoint_after_mb = 256;  // of journal, whichever comes first
  std::size_t max_capsules = 16;            // failure capsules kept in state_dir, the first ones
  bool accept_empty = false;                // set state files that cannot be used aside, and start without them
  std::vector<std::uint32_t> allow_uids;    // who may use ipc endpoints; empty: the user the server runs as
  std::string curve_secret;                 // file of the server's secret key; tcp clients must have keys then,
  std::string authorized_keys;              // and theirs are in this file
  bool insecure_plaintext = false;          // tcp without keys: whoever reaches it is served
  std::string log_level = "info";           // trace, debug, info, warn, error, off
  std::string log_file;                     // empty: standard error
};

}  // namespace shearbus::server
