// Structures of the store's files, as FORMAT.md describes them. Little-endian. A sum is a hash that detects damage. No
// length is used before the sum that covers it has been compared.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "proto/wire/text.hpp"

namespace shearbus::store {

static_assert(std::endian::native == std::endian::little, "files are written as they stand in memory");

// Thrown for a damaged file and for a file of another format version. Its text names the file and the fault.
class DamagedFile : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};
// Of sound bytes which this server, with other options than it had, does not take.
class OtherOptions : public DamagedFile {
  using DamagedFile::DamagedFile;
};

// Thrown for a journal whose requests another version of the numerics must replay. No file is damaged.
class OtherNumerics : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

inline constexpr std::uint16_t kJournalVersion = 3;
inline constexpr std::uint32_t kCheckpointVersion = 3;
inline constexpr std::uint32_t kIdentityVersion = 1;
inline constexpr std::uint32_t kCapsuleVersion = 1;
inline constexpr std::array<char, 8> kJournalMagic = {'S', 'H', 'B', 'J', 'R', 'N', 'L', '\n'};
inline constexpr std::array<char, 8> kCheckpointMagic = {'S', 'H', 'B', 'C', 'K', 'P', 'T', '\n'};
inline constexpr std::array<char, 8> kIdentityMagic = {'S', 'H', 'B', 'S', 'T', 'O', 'R', '\n'};

using SessionKey = std::array<std::uint8_t, 16>;
// random number of a state directory, in its file `store`, checkpoints and segments
using StoreId = std::array<std::uint8_t, 16>;

// The file `store`: the directory's id, and the newest files that the directory has held. The file is written and
// synced before the first record of a segment and after every checkpoint, so that a lost file is noticed.
struct StoreIdentity {
  std::array<char, 8> magic = kIdentityMagic;
  std::uint32_t version = kIdentityVersion;
  std::uint32_t reserved = 0;
  StoreId id{};
  std::uint64_t last_segment = 0;     // number of the newest segment; 0: there has been none
  std::uint64_t first_index = 0;      // index of the first record of the newest segment
  std::uint64_t last_checkpoint = 0;  // generation of the newest checkpoint; 0: there has been none
  std::uint64_t sum = 0;              // XXH3-64 of the fields above
};
static_assert(sizeof(StoreIdentity) == 64);
inline constexpr const char* kIdentityName = "store";

// Header at the start of every journal segment.
struct SegmentHeader {
  std::array<char, 8> magic = kJournalMagic;
  std::uint16_t version = kJournalVersion;
  std::uint16_t numerics = 0;  // version of the numerics that answered the requests
  std::uint32_t header_bytes = 80;
  std::uint64_t number = 0;       // number of the segment, as in its file name
  std::uint64_t epoch = 0;        // epoch of the server that wrote the segment, as in the replies that it sent
  std::uint64_t first_index = 0;  // index of the first record of the segment
  StoreId store{};                // id of the state directory
  std::uint64_t sum = 0;          // XXH3-64 of the fields above
  // Index behind the last settled record: it is written whole and, with Durability::kPower, synced. This field is
  // written again, in place, whenever records have been settled.
  std::uint64_t settled = 0;
  std::uint64_t settled_sum = 0;  // XXH3-64 of `settled`, with `sum` as seed
};
static_assert(sizeof(SegmentHeader) == 80);

// Header before the bytes of every record. The XXH3-64 of header and bytes follows the bytes.
struct RecordHeader {
  std::uint64_t index = 0;  // number of the record, without gaps across all segments
  SessionKey session{};
  std::uint64_t sequence = 0;        // sequence number of the request in its session
  std::uint64_t previous_reply = 0;  // hash of the session's reply before this request; a replay must give this hash
  std::uint32_t header_frame_bytes = 0;
  std::uint32_t payload_frame_bytes = 0;
  std::uint32_t identity_bytes = 0;
  std::uint32_t reserved = 0;
  std::uint64_t sum = 0;  // XXH3-64 of the fields above: checked before the lengths are used
};
static_assert(sizeof(RecordHeader) == 64);
// Lengths of the parts of a record, in their order.
inline std::array<std::uint32_t, 3> lengths(const RecordHeader& header) {
  return {header.identity_bytes, header.header_frame_bytes, header.payload_frame_bytes};
}
inline constexpr std::uint64_t kMaxFrameBytes = std::uint64_t{1} << 30;  // largest frame of any protocol version

// Footer of every checkpoint, after the HDF5 image.
struct CheckpointFooter {
  std::uint64_t image_bytes = 0;
  std::uint64_t generation = 0;              // number of the checkpoint, as in its file name
  std::array<std::uint64_t, 2> image_sum{};  // XXH3-128 of the image
  StoreId store{};                           // id of the state directory
  std::uint32_t version = kCheckpointVersion;
  std::uint32_t reserved = 0;
  std::array<char, 8> magic = kCheckpointMagic;
  std::uint64_t sum = 0;  // XXH3-64 of the fields above
};
static_assert(sizeof(CheckpointFooter) == 72);

using wire::hexadecimal;

inline std::string numbered(const char* prefix, std::uint64_t number, const char* suffix) {
  std::string digits = std::to_string(number);
  return prefix + std::string(digits.size() < 12 ? 12 - digits.size() : 0, '0') + digits + suffix;
}
inline std::string segment_name(std::uint64_t number) {
  return numbered("journal-", number, ".log");
}
inline std::string checkpoint_name(std::uint64_t generation) {
  return numbered("checkpoint-", generation, ".h5");
}
inline std::string capsule_name(std::uint64_t number) {
  return numbered("capsule-", number, ".h5");
}

}  // namespace shearbus::store
