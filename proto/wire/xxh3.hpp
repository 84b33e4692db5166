// The checksum of payload frames, and the hash that distinguishes requests.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace shearbus::wire {

// Returns the XXH3-64 of the bytes, computed with AVX2 where the processor has it. The result is the same everywhere.
std::uint64_t xxh3(std::span<const std::byte> bytes, std::uint64_t seed = 0);

}  // namespace shearbus::wire
