// The framing of files that hold records end to end: the journal of a server (server/store/FORMAT.md) and event logs
// (event_log.md). A record is a header, kParts parts and the sum of both. The first field of the header is the index of
// the record, its last one the sum of the fields before, and lengths(header) gives the lengths of the parts.
#pragma once

#include <sys/uio.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>

#include "proto/wire/xxh3.hpp"

namespace shearbus::files {

using Bytes = std::span<const std::byte>;

template <typename Value>
Bytes bytes_of(const Value& value) {
  return std::as_bytes(std::span(&value, 1));
}

// The sum of each part is the seed of the next part's sum. A stored sum is never 0, so that it differs from the parts of
// a file that were never written, which read as 0.
inline std::uint64_t sum_of(std::span<const Bytes> parts, std::uint64_t seed = 0) {
  for (const Bytes part : parts) seed = wire::xxh3(part, seed);
  return std::max<std::uint64_t>(seed, 1);
}

template <typename Header>
std::uint64_t sum_of_header(const Header& header) {
  return sum_of(std::array{bytes_of(header).first(offsetof(Header, sum))});
}

inline bool all_zero(Bytes bytes) {
  return std::ranges::all_of(bytes, [](std::byte byte) { return byte == std::byte{0}; });
}

template <typename Header, std::size_t kParts>
struct FileRecord {
  Header header;
  std::array<Bytes, kParts> parts{};
  std::uint64_t sum = 0;

  // Sets both sums. Returns the bytes of the file, which point into the record and its parts.
  auto sealed() {
    header.sum = sum_of_header(header);
    sum = expected_sum();
    return pieces();
  }

  // Reads record `index` from a source, which has take(n): the next n bytes, or fewer at the end of the file. Calls
  // refuse(text), which throws, for a damaged record. Returns false at the end and for a torn record: the file is too
  // short for it, or ends in zeros because its length reached the disk before its data.
  template <typename Source, typename Refuse>
  bool read(Source& source, std::uint64_t index, std::uint64_t largest_part, const Refuse& refuse) {
    const Bytes first = source.take(sizeof header);
    if (first.size() < sizeof header) return false;
    std::memcpy(&header, first.data(), sizeof header);
    for (Bytes zeros = first; all_zero(zeros); zeros = source.take(4096))
      if (zeros.empty()) return false;
    if (header.sum != sum_of_header(header)) refuse("the header of a record does not match its sum");
    if (header.index != index)
      refuse("record " + std::to_string(header.index) + " where " + std::to_string(index) + " should be");
    std::uint64_t length = sizeof sum;
    for (const std::uint32_t part : lengths(header)) {
      if (part > largest_part) refuse("a record longer than any that is written");
      length += part;
    }
    Bytes rest = source.take(length);
    if (rest.size() < length) return false;
    for (std::size_t i = 0; i < kParts; ++i) {
      parts[i] = rest.first(lengths(header)[i]);
      rest = rest.subspan(parts[i].size());
    }
    std::memcpy(&sum, rest.data(), sizeof sum);
    if (sum == expected_sum()) return true;
    if (sum != 0 || !source.take(1).empty())
      refuse("record " + std::to_string(header.index) + " does not match its sum");
    return false;
  }

 private:
  std::uint64_t expected_sum() const {
    const auto all = pieces();
    return sum_of(std::span(all).first(kParts + 1));
  }
  std::array<Bytes, kParts + 2> pieces() const {
    std::array<Bytes, kParts + 2> all{bytes_of(header)};
    std::ranges::copy(parts, all.begin() + 1);
    all.back() = bytes_of(sum);
    return all;
  }
};

// Writes at most 8 parts in their order. Returns 0, or the errno of a failed call, before which any prefix of the bytes
// may have been written.
inline int write_parts(int file, std::span<const Bytes> parts) {
  std::array<iovec, 8> left{};
  std::size_t first = 0, count = 0;
  // The cast is safe: writev does not change the bytes.
  for (const Bytes part : parts)
    if (!part.empty()) left.at(count++) = {const_cast<std::byte*>(part.data()), part.size()};
  while (first < count) {
    ssize_t written = ::writev(file, left.data() + first, static_cast<int>(count - first));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return errno;
    while (first < count && static_cast<std::size_t>(written) >= left[first].iov_len)
      written -= static_cast<ssize_t>(left[first++].iov_len);
    if (first < count) {
      left[first].iov_base = static_cast<std::byte*>(left[first].iov_base) + written;
      left[first].iov_len -= static_cast<std::size_t>(written);
    }
  }
  return 0;
}

}  // namespace shearbus::files
