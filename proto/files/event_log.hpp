// Event logs: the exchanges of a session as the frames that were sent. event_log.md describes the file.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "proto/wire/handle.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::files {

inline constexpr std::uint32_t kEventLogVersion = 1;
enum class Recorder : std::uint32_t { kServer = 1, kClient = 2 };

struct EventLogHead {
  wire::SessionId session_id{};
  std::uint64_t created_ns = 0;  // time of day, since 1970
  Recorder recorder = Recorder::kServer;
  std::string scene;  // effective scene as TOML text
};

// A request and the reply to it. A payload is empty if its header declares none; both parts of the reply are empty if
// no reply came.
struct ExchangeFrames {
  std::span<const std::byte> request_header;
  std::span<const std::byte> request_payload;
  std::span<const std::byte> reply_header;
  std::span<const std::byte> reply_payload;
};

// Appends exchanges to the log of a session. A call that throws std::runtime_error has changed nothing in the file, or
// leaves an incomplete record, which readers leave out.
class EventLogWriter {
 public:
  // Makes a file that only its owner can read; its name must be free.
  EventLogWriter(const std::filesystem::path& file, const EventLogHead& head);
  // Continues the file of a session behind its last complete record.
  EventLogWriter(const std::filesystem::path& file, const wire::SessionId& session_id);

  void append(const ExchangeFrames& frames, std::uint64_t time_ns);
  void sync();  // after the call the records survive a loss of power

 private:
  void lock() const;
  void write(std::span<const std::span<const std::byte>> parts);
  [[noreturn]] void fail(const char* doing, int code) const;

  std::string name_;
  wire::Descriptor file_;
  std::uint64_t bytes_ = 0;  // length of the file up to the last complete record
  std::uint64_t next_index_ = 0;
};

// Reads the exchanges of a log in their order. Throws Error{kInvalidValue} for a file that no recorder has written.
class EventLogReader {
 public:
  explicit EventLogReader(const std::filesystem::path& file);

  const EventLogHead& head() const { return head_; }
  // Reads the next exchange. Returns false behind the last complete one.
  bool next();
  std::span<const std::byte> take(std::size_t count);  // for next()
  // The exchange that next() has read, valid until the next call.
  const ExchangeFrames& frames() const { return frames_; }
  std::uint64_t index() const { return next_index_ - 1; }
  std::uint64_t time_ns() const { return time_ns_; }
  // Whether an incomplete record follows the last complete one, as after the death of the recorder.
  bool torn() const { return torn_; }

  std::uint64_t sound_bytes() const { return sound_bytes_; }  // length of the file up to the last complete record
  std::uint64_t next_index() const { return next_index_; }

 private:
  [[noreturn]] void refuse(const std::string& what) const;

  std::string name_;
  std::ifstream stream_;
  EventLogHead head_;
  std::vector<std::byte> taken_;
  ExchangeFrames frames_;
  std::uint64_t time_ns_ = 0;
  std::uint64_t next_index_ = 0;
  std::uint64_t sound_bytes_ = 0;
  bool torn_ = false;
};

// Whether a file begins with the mark of event logs.
bool is_event_log(const std::filesystem::path& file);

}  // namespace shearbus::files
