// Limits on everything that arrives from outside. The reply `welcome` publishes those of the struct Limits
// (messages.hpp).
#pragma once

#include <cstddef>
#include <cstdint>

namespace shearbus::wire {

inline constexpr std::uint32_t kMagic = 0x31425353;  // "SSB1" in little-endian bytes
inline constexpr std::uint32_t kProtocolMajor = 1;
inline constexpr std::uint32_t kProtocolMinor = 0;

inline constexpr std::size_t kSessionIdBytes = 16;
inline constexpr std::size_t kMaxFrames = 2;  // frames of one message: header and payload
inline constexpr std::size_t kMaxColumns = 32;
inline constexpr std::size_t kMaxBytesPerNode = std::size_t{18} * 8;    // bytes of the widest row of a request or reply
inline constexpr std::size_t kMaxBytesPerNewNode = std::size_t{2} * 8;  // node_id and initial_temperature_k
inline constexpr std::size_t kMaxPairs = 256;                           // pairs that a scene names
inline constexpr std::size_t kMaxParameters = 24;           // keys of a scene that have a value for each node
inline constexpr std::size_t kMaxParameterSets = 4'096;     // different sets of parameters in one request
inline constexpr std::size_t kMaxRowsPerMessage = 200'000;  // rows of a step or of one of its parts
inline constexpr std::size_t kMaxNodesPerSession = 2'000'000;
inline constexpr std::size_t kMaxSessions = 1'024;
// largest number of marks of a session; a mark holds a copy of the session's states
inline constexpr std::size_t kMaxMarks = 2;
inline constexpr std::size_t kMaxNameBytes = 128;  // length of the name of a mark or a domain
// largest number of offers (transfers of nodes to another session) of a session that wait to be accepted
inline constexpr std::size_t kMaxOffers = 256;
inline constexpr std::size_t kMaxTopNodes = 1'024;
inline constexpr std::size_t kMaxSessionsListed = 128;  // sessions listed in one reply
inline constexpr std::uint64_t kMaxDrainS =
    std::uint64_t{365} * 86'400;  // longest time that a drain may give the sessions
// Bucket 0 of a histogram counts durations below this value, bucket i durations from this value times 2^(i-1) to times
// 2^i; the last bucket also counts all longer durations  [ns]
inline constexpr std::uint64_t kHistogramBaseNs = 1024;
inline constexpr std::size_t kMaxHeaderBytes = std::size_t{512} * 1024;
inline constexpr std::size_t kMaxPayloadBytes = std::size_t{32} * 1024 * 1024;
// length of a text in a header, except scenes and lists of faults
inline constexpr std::size_t kMaxTextBytes = std::size_t{4} * 1024;
// length of a scene, or of the list of its faults
inline constexpr std::size_t kMaxSceneBytes = std::size_t{256} * 1024;
inline constexpr std::size_t kMaxSceneKeys = 16'384;  // keys, tables and values of lists in a scene's text, together

static_assert(kMaxRowsPerMessage * kMaxBytesPerNode <= kMaxPayloadBytes);
static_assert(kMaxNodesPerSession * kMaxBytesPerNewNode <= kMaxPayloadBytes);
static_assert(kMaxHeaderBytes <= kMaxPayloadBytes);
static_assert(kMaxSceneBytes + 16 * kMaxTextBytes <= kMaxHeaderBytes);

}  // namespace shearbus::wire
