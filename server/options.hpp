// Every option of the server with its default. main.cpp reads them from the command line.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace shearbus::server {

struct ServerOptions {
  std::vector<std::string> endpoints;       // addresses to listen at: tcp://address:port or ipc://path
  unsigned threads = 0;                     // threads that solve layers, including the socket's thread; 0: one per core
  std::size_t nodes_per_task = 512;         // smallest number of nodes per thread if several threads share a step
  double max_work_budget = 3e9;             // largest work_budget of a scene, at least the default  [evaluations]
  std::uint64_t max_state_bytes = 0;        // limit of all sessions' states; 0: three quarters of the machine's memory
  std::size_t sessions_per_user = 0;        // quota of a user who is no operator; 0: three quarters of all sessions
  std::uint64_t state_bytes_per_user = 0;   // likewise of memory; 0: three quarters of max_state_bytes
  std::vector<std::string> own_laws;        // friction laws of shared libraries, each NAME=FILE
  std::string endpoint_file;                // file that gets the address of the first endpoint; empty: none
  std::string state_dir;                    // directory of checkpoints and journal; empty: sessions end with the server
  std::string durability = "process";       // with state_dir: "none", "process" or "power" (server/store/store.hpp)
  double checkpoint_every_s = 600.0;        // interval between checkpoints, if anything has changed  [s]
  std::uint64_t checkpoint_after_mb = 256;  // journal size that triggers a checkpoint before the interval ends  [MB]
  double checkpoint_work = 3e9;             // work that triggers a checkpoint before the interval ends  [evaluations]
  std::size_t max_capsules = 16;  // largest number of failure capsules in state_dir; later ones are not written
  std::vector<std::string> drop_sessions;    // sessions that the recovery leaves out, by the first digits of their ids
  std::vector<std::uint64_t> drop_records;   // journal records that it leaves out, with the rest of their sessions
  bool accept_empty = false;                 // rename unusable state files and start empty
  std::string record_dir;                    // directory of event logs; empty: nothing is recorded
  std::vector<std::string> record_sessions;  // with record_dir: scenes or domains to record; empty: all sessions
  std::vector<std::uint32_t> allow_uids;     // uids that may use ipc endpoints beside the server's own
  std::string curve_secret;                  // file of the server's secret key; with it tcp clients must have keys
  std::string authorized_keys;               // file of the keys of tcp clients, with curve_secret
  bool insecure_plaintext = false;           // allows tcp without keys: every client that connects is served
  std::string log_level = "info";            // trace, debug, info, warn, error or off
  std::string log_file;                      // file of the log; empty: standard error
};

}  // namespace shearbus::server
