#include "proto/files/event_log.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>

#include "proto/files/input_file.hpp"
#include "proto/files/record_file.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/wire/limits.hpp"

namespace shearbus::files {
namespace {

static_assert(std::endian::native == std::endian::little, "files are written as they stand in memory");

constexpr std::array<char, 8> kEventLogMagic = {'S', 'H', 'B', 'E', 'V', 'L', 'G', '\n'};

struct FileHeader {
  std::array<char, 8> magic = kEventLogMagic;
  std::uint32_t version = kEventLogVersion;
  std::uint32_t header_bytes = 64;
  wire::SessionId session_id{};
  std::uint64_t created_ns = 0;
  Recorder recorder = Recorder::kServer;
  std::uint32_t scene_bytes = 0;
  std::uint64_t scene_sum = 0;  // XXH3-64 of the scene's text, which follows the header
  std::uint64_t sum = 0;        // XXH3-64 of the fields above
};
static_assert(sizeof(FileHeader) == 64);

struct RecordHeader {
  std::uint64_t index = 0;
  std::uint64_t time_ns = 0;
  std::array<std::uint32_t, 4> bytes{};  // lengths of the four frames
  std::uint64_t sum = 0;                 // XXH3-64 of the fields above: checked before the lengths are used
};
static_assert(sizeof(RecordHeader) == 40);

const std::array<std::uint32_t, 4>& lengths(const RecordHeader& header) {
  return header.bytes;
}

using EventRecord = FileRecord<RecordHeader, 4>;

}  // namespace

EventLogWriter::EventLogWriter(const std::filesystem::path& file, const EventLogHead& head) : name_(file.string()) {
  file_ = wire::Descriptor(::open(name_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (file_ < 0 && errno == EEXIST)
    throw std::runtime_error(name_ +
                             " exists already; name a new file, or a directory with / at its end, for the recording");
  if (file_ < 0) fail("cannot make", errno);
  FileHeader header{.session_id = head.session_id,
                    .created_ns = head.created_ns,
                    .recorder = head.recorder,
                    .scene_bytes = static_cast<std::uint32_t>(head.scene.size()),
                    .scene_sum = wire::xxh3(std::as_bytes(std::span(head.scene)))};
  header.sum = sum_of_header(header);
  const std::array<Bytes, 2> parts = {bytes_of(header), std::as_bytes(std::span(head.scene))};
  try {
    lock();
    write(parts);
  } catch (const std::exception&) {
    ::unlink(name_.c_str());
    throw;
  }
}

EventLogWriter::EventLogWriter(const std::filesystem::path& file, const wire::SessionId& session_id)
    : name_(file.string()) {
  EventLogReader reader(file);
  if (reader.head().session_id != session_id)
    throw std::runtime_error(fmt::format("{} is the log of another session", name_));
  file_ = wire::Descriptor(::open(name_.c_str(), O_WRONLY | O_CLOEXEC | O_NOFOLLOW));
  if (file_ < 0) fail("cannot continue", errno);
  lock();
  while (reader.next()) {
  }
  bytes_ = reader.sound_bytes();
  next_index_ = reader.next_index();
  const auto end = static_cast<off_t>(bytes_);
  if (::ftruncate(file_, end) < 0 || ::lseek(file_, end, SEEK_SET) < 0) fail("cannot continue", errno);
}

// Two recorders must not write to one file, such as a client and one that has resumed its session.
void EventLogWriter::lock() const {
  if (::flock(file_, LOCK_EX | LOCK_NB) < 0 && errno == EWOULDBLOCK)
    throw std::runtime_error(fmt::format("another recorder writes to {}", name_));
}

void EventLogWriter::fail(const char* doing, int code) const {
  throw std::runtime_error(fmt::format("{} {}: {}", doing, name_, std::generic_category().message(code)));
}

// Appends all parts in order. What was written of an incomplete record is removed again.
void EventLogWriter::write(std::span<const Bytes> parts) {
  std::uint64_t total = 0;
  for (const Bytes part : parts) total += part.size();
  // A write beyond the largest size of a file would end the process by SIGXFSZ, which belongs to the host.
  rlimit largest{};
  if (::getrlimit(RLIMIT_FSIZE, &largest) == 0 && largest.rlim_cur != RLIM_INFINITY &&
      bytes_ + total > largest.rlim_cur)
    fail("cannot write", EFBIG);
  if (const int fault = write_parts(file_, parts)) {
    const auto end = static_cast<off_t>(bytes_);
    static_cast<void>(::ftruncate(file_, end) == 0 && ::lseek(file_, end, SEEK_SET) == end);
    fail("cannot write", fault);
  }
  bytes_ += total;
}

void EventLogWriter::append(const ExchangeFrames& frames, std::uint64_t time_ns) {
  EventRecord record{
      .header = {.index = next_index_, .time_ns = time_ns},
      .parts = {frames.request_header, frames.request_payload, frames.reply_header, frames.reply_payload}};
  std::ranges::transform(record.parts, record.header.bytes.begin(),
                         [](Bytes part) { return static_cast<std::uint32_t>(part.size()); });
  write(record.sealed());
  ++next_index_;
}

void EventLogWriter::sync() {
  if (::fdatasync(file_) < 0) fail("cannot bring to the disk", errno);
}

EventLogReader::EventLogReader(const std::filesystem::path& file) : name_(file.string()) {
  const RegularFile regular(file);  // refuses a pipe, which would keep the stream waiting
  stream_.open(file, std::ios::binary);
  if (!stream_) throw wire::Error({.code = wire::Code::kInvalidValue, .text = name_ + ": cannot be read"});
  FileHeader header;
  const Bytes first = take(sizeof header);
  std::memcpy(&header, first.data(), first.size());
  if (first.size() < sizeof header || header.magic != kEventLogMagic)
    refuse("not an event log: it does not begin with the mark of event logs");
  if (header.version != kEventLogVersion)
    refuse(fmt::format("event log version {}; this program reads version {}", header.version, kEventLogVersion));
  if (header.sum != sum_of_header(header) || header.header_bytes != sizeof header)
    refuse("the header does not match its sum");
  if (header.scene_bytes > wire::kMaxSceneBytes) refuse("a scene longer than any server sends");
  const Bytes scene = take(header.scene_bytes);
  head_ = {.session_id = header.session_id,
           .created_ns = header.created_ns,
           .recorder = header.recorder,
           .scene = {reinterpret_cast<const char*>(scene.data()), scene.size()}};
  if (head_.scene.size() != header.scene_bytes || wire::xxh3(std::as_bytes(std::span(head_.scene))) != header.scene_sum)
    refuse("the scene does not match its sum");
  sound_bytes_ = sizeof header + head_.scene.size();
  torn_ = false;
}

void EventLogReader::refuse(const std::string& what) const {
  throw wire::Error(
      {.code = wire::Code::kInvalidValue, .text = fmt::format("{}, byte {}: {}", name_, sound_bytes_, what)});
}

// Returns the next bytes of the file, or fewer at its end. They are valid until the next call.
Bytes EventLogReader::take(std::size_t count) {
  taken_.resize(count);
  stream_.read(reinterpret_cast<char*>(taken_.data()), static_cast<std::streamsize>(count));
  taken_.resize(static_cast<std::size_t>(stream_.gcount()));
  torn_ = torn_ || !taken_.empty();
  return taken_;
}

bool EventLogReader::next() {
  EventRecord record;
  if (torn_ ||
      !record.read(*this, next_index_, wire::kMaxPayloadBytes, [this](const std::string& what) { refuse(what); }))
    return false;
  frames_ = {record.parts[0], record.parts[1], record.parts[2], record.parts[3]};
  time_ns_ = record.header.time_ns;
  sound_bytes_ += sizeof(RecordHeader) + taken_.size();
  ++next_index_;
  torn_ = false;
  return true;
}

bool is_event_log(const std::filesystem::path& file) {
  return std::ranges::equal(head_of(file, kEventLogMagic.size()), kEventLogMagic);
}

}  // namespace shearbus::files
