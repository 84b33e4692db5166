// Records exchanges to event logs, one file per session, for the server and for a client.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "proto/files/event_log.hpp"

namespace shearbus::files {

struct RecorderOptions {
  // A directory, which gets a file session-ID.log of each session; for a client also the name of a new file, which gets
  // its first session.
  std::filesystem::path place;
  Recorder recorder = Recorder::kServer;
  std::vector<std::string> sessions;  // names of scenes or domains; empty: records all sessions
  // Receives one line if the recording of a session stops, and whether it has failed.
  std::function<void(const std::string& line, bool failed)> log;
};

// One thread at a time may call it.
class SessionRecorder {
 public:
  // Makes the directory, readable by its owner, unless it exists. Throws std::runtime_error if it cannot be used.
  explicit SessionRecorder(RecorderOptions options);

  // Appends an exchange to the log of its session. A log begins with the opening of its session, or is continued after
  // a restart of the recorder; exchanges of other sessions are not recorded. The first fault ends the recording of the
  // session.
  void add(const ExchangeFrames& frames) noexcept;

 private:
  using Log = std::optional<EventLogWriter>;  // none: the session is not recorded
  Log* begin(std::uint32_t verb, const wire::SessionId& id, const ExchangeFrames& frames);
  std::filesystem::path file_of(const wire::SessionId& id) const;
  bool wanted(const ExchangeFrames& frames, const wire::SessionOpened& opened) const;
  std::uint64_t time_ns();
  void stop(const wire::SessionId& id, const std::string& why, bool failed) noexcept;

  RecorderOptions options_;
  bool one_file_ = false;
  std::map<wire::SessionId, Log> sessions_;
  std::uint64_t last_time_ns_ = 0;
};

}  // namespace shearbus::files
