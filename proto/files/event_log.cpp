#include "proto/files/event_log.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>
#define XXH_INLINE_ALL  // client libraries need no libxxhash
#include <xxhash.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>

#include "proto/files/input_file.hpp"
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
constexpr std::size_t kSumBytes = 8;

// A stored sum is never 0, so that it differs from the parts of a file that were never written, which read as 0.
std::uint64_t never_zero(std::uint64_t sum) {
  return sum != 0 ? sum : 1;
}

template <typename Header>
std::uint64_t sum_of_header(const Header& header) {
  return never_zero(XXH3_64bits(&header, offsetof(Header, sum)));
}

template <typename Value>
std::span<const std::byte> bytes_of(const Value& value) {
  return std::as_bytes(std::span(&value, 1));
}

// The sum of each part is the seed of the next part's sum.
std::uint64_t sum_of_parts(std::span<const std::span<const std::byte>> parts) {
  std::uint64_t sum = 0;
  for (const auto part : parts) sum = XXH3_64bits_withSeed(part.data(), part.size(), sum);
  return never_zero(sum);
}

bool all_zero(std::span<const std::byte> bytes) {
  return std::ranges::all_of(bytes, [](std::byte byte) { return byte == std::byte{0}; });
}

}  // namespace

EventLogWriter::EventLogWriter(const std::filesystem::path& file, const EventLogHead& head) : name_(file.string()) {
  file_ = ::open(name_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (file_ < 0) fail("cannot make", errno);
  FileHeader header{.session_id = head.session_id,
                    .created_ns = head.created_ns,
                    .recorder = head.recorder,
                    .scene_bytes = static_cast<std::uint32_t>(head.scene.size()),
                    .scene_sum = XXH3_64bits(head.scene.data(), head.scene.size())};
  header.sum = sum_of_header(header);
  const std::array<Part, 2> parts = {bytes_of(header), std::as_bytes(std::span(head.scene))};
  try {
    lock();
    write(parts);
  } catch (const std::exception&) {
    ::unlink(name_.c_str());
    ::close(file_);
    throw;
  }
}

EventLogWriter::EventLogWriter(const std::filesystem::path& file, const wire::SessionId& session_id)
    : name_(file.string()) {
  EventLogReader reader(file);
  if (reader.head().session_id != session_id)
    throw std::runtime_error(fmt::format("{} is the log of another session", name_));
  file_ = ::open(name_.c_str(), O_WRONLY | O_CLOEXEC | O_NOFOLLOW);
  if (file_ < 0) fail("cannot continue", errno);
  try {
    lock();
    continue_behind(reader);
  } catch (const std::exception&) {
    ::close(file_);
    throw;
  }
}

// Two recorders must not write to one file, such as a client and one that has resumed its session.
void EventLogWriter::lock() const {
  if (::flock(file_, LOCK_EX | LOCK_NB) < 0 && errno == EWOULDBLOCK)
    throw std::runtime_error(fmt::format("another recorder writes to {}", name_));
}

void EventLogWriter::continue_behind(EventLogReader& reader) {
  while (reader.next()) {
  }
  bytes_ = reader.sound_bytes();
  next_index_ = reader.next_index();
  const auto end = static_cast<off_t>(bytes_);
  if (::ftruncate(file_, end) < 0 || ::lseek(file_, end, SEEK_SET) < 0) fail("cannot continue", errno);
}

EventLogWriter::~EventLogWriter() {
  ::close(file_);
}

void EventLogWriter::fail(const char* doing, int code) const {
  throw std::runtime_error(fmt::format("{} {}: {}", doing, name_, std::generic_category().message(code)));
}

// Appends all parts in order. What was written of an incomplete record is removed again.
void EventLogWriter::write(std::span<const Part> parts) {
  std::array<iovec, 8> vectors{};
  std::size_t count = 0;
  std::uint64_t total = 0;
  for (const Part part : parts) {
    total += part.size();
    // The cast is safe: writev does not change the bytes.
    if (!part.empty()) vectors.at(count++) = {const_cast<std::byte*>(part.data()), part.size()};
  }
  // A write beyond the largest size of a file would end the process by SIGXFSZ, which belongs to the host.
  rlimit largest{};
  if (::getrlimit(RLIMIT_FSIZE, &largest) == 0 && largest.rlim_cur != RLIM_INFINITY &&
      bytes_ + total > largest.rlim_cur)
    fail("cannot write", EFBIG);
  for (std::size_t first = 0; first < count;) {
    ssize_t written = ::writev(file_, vectors.data() + first, static_cast<int>(count - first));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) {
      const int fault = errno;
      const auto end = static_cast<off_t>(bytes_);
      static_cast<void>(::ftruncate(file_, end) == 0 && ::lseek(file_, end, SEEK_SET) == end);
      fail("cannot write", fault);
    }
    while (first < count && static_cast<std::size_t>(written) >= vectors[first].iov_len)
      written -= static_cast<ssize_t>(vectors[first++].iov_len);
    if (first < count) {
      vectors[first].iov_base = static_cast<std::byte*>(vectors[first].iov_base) + written;
      vectors[first].iov_len -= static_cast<std::size_t>(written);
    }
  }
  bytes_ += total;
}

void EventLogWriter::append(const ExchangeFrames& frames, std::uint64_t time_ns) {
  const std::array<Part, 4> four = {frames.request_header, frames.request_payload, frames.reply_header,
                                    frames.reply_payload};
  RecordHeader header{.index = next_index_, .time_ns = time_ns};
  for (std::size_t i = 0; i < four.size(); ++i) header.bytes[i] = static_cast<std::uint32_t>(four[i].size());
  header.sum = sum_of_header(header);
  std::array<Part, 6> parts = {bytes_of(header), four[0], four[1], four[2], four[3], {}};
  const std::uint64_t sum = sum_of_parts(std::span(parts).first(5));
  parts[5] = bytes_of(sum);
  write(parts);
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
  if (!read(std::as_writable_bytes(std::span(&header, 1))) || header.magic != kEventLogMagic)
    refuse("not an event log: it does not begin with the mark of event logs");
  if (header.version != kEventLogVersion)
    refuse(fmt::format("event log version {}; this program reads version {}", header.version, kEventLogVersion));
  if (header.sum != sum_of_header(header) || header.header_bytes != sizeof header)
    refuse("the header does not match its sum");
  if (header.scene_bytes > wire::kMaxSceneBytes) refuse("a scene longer than any server sends");
  head_ = {.session_id = header.session_id,
           .created_ns = header.created_ns,
           .recorder = header.recorder,
           .scene = std::string(header.scene_bytes, '\0')};
  if (!read(std::as_writable_bytes(std::span(head_.scene))) ||
      XXH3_64bits(head_.scene.data(), head_.scene.size()) != header.scene_sum)
    refuse("the scene does not match its sum");
  sound_bytes_ = sizeof header + head_.scene.size();
  torn_ = false;
}

void EventLogReader::refuse(const std::string& what) const {
  throw wire::Error(
      {.code = wire::Code::kInvalidValue, .text = fmt::format("{}, byte {}: {}", name_, sound_bytes_, what)});
}

// Returns false if the file ends first.
bool EventLogReader::read(std::span<std::byte> bytes) {
  stream_.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  const auto got = static_cast<std::size_t>(stream_.gcount());
  torn_ = torn_ || got > 0;
  return got == bytes.size();
}

bool EventLogReader::next() {
  if (torn_) return false;
  RecordHeader header;
  if (!read(std::as_writable_bytes(std::span(&header, 1))) || all_zero(bytes_of(header))) return false;
  if (header.sum != sum_of_header(header)) refuse("the header of a record does not match its sum");
  if (header.index != next_index_) refuse(fmt::format("record {} where {} should be", header.index, next_index_));
  std::size_t length = 0;
  for (const std::uint32_t bytes : header.bytes) {
    if (bytes > wire::kMaxPayloadBytes) refuse("a record longer than any exchange");
    length += bytes;
  }
  record_.resize(length + kSumBytes);
  if (!read(record_)) return false;
  std::uint64_t sum = 0;
  std::memcpy(&sum, record_.data() + length, sizeof sum);
  std::span<const std::byte> rest = record_;
  const auto take = [&](std::uint32_t bytes) {
    const auto part = rest.first(bytes);
    rest = rest.subspan(bytes);
    return part;
  };
  frames_.request_header = take(header.bytes[0]);
  frames_.request_payload = take(header.bytes[1]);
  frames_.reply_header = take(header.bytes[2]);
  frames_.reply_payload = take(header.bytes[3]);
  const std::array parts = {bytes_of(header), frames_.request_header, frames_.request_payload, frames_.reply_header,
                            frames_.reply_payload};
  if (sum != sum_of_parts(parts)) {
    // If the length of a file reached the disk before its data, the file ends in zeros.
    if (sum == 0 && stream_.peek() == std::ifstream::traits_type::eof()) return false;
    refuse(fmt::format("record {} does not match its sum", header.index));
  }
  time_ns_ = header.time_ns;
  sound_bytes_ += sizeof header + record_.size();
  ++next_index_;
  torn_ = false;
  return true;
}

bool is_event_log(const std::filesystem::path& file) {
  return std::ranges::equal(head_of(file, kEventLogMagic.size()), kEventLogMagic);
}

}  // namespace shearbus::files
