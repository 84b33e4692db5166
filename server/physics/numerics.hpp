// The version of the numerics: raised by every change after which some step of some scene has other bits. A journal
// says which version answered its requests, since only that version gives the same answers when it replays them.
// tests/unit/physics_bits.cpp notices most of such changes.
#pragma once

#include <cstdint>

namespace shearbus::physics {

inline constexpr std::uint16_t kNumericsVersion = 17;

}  // namespace shearbus::physics
