// A tile holds kLanes shear layers side by side and is the unit of work of the solvers. Arrays across the layer are
// [vertex][lane], lane fastest: the sweep across the layer is sequential and the lanes vectorise. No value of one lane
// enters the arithmetic of another lane, so the answer of a lane has the same bits whatever the other lanes hold.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

namespace shearbus::physics {

inline constexpr int kLanes = 8;
inline constexpr std::uint32_t kAllLanes = (1u << kLanes) - 1;  // the set of all lanes

// A set of lanes: bit i stands for lane i. A loop visits the lanes in ascending order.
class LaneSet {
 public:
  class Iterator {
   public:
    constexpr explicit Iterator(std::uint32_t left) : left_(left) {}
    constexpr int operator*() const { return std::countr_zero(left_); }
    constexpr Iterator& operator++() {
      left_ &= left_ - 1;
      return *this;
    }
    constexpr bool operator==(const Iterator&) const = default;

   private:
    std::uint32_t left_;
  };
  constexpr explicit LaneSet(std::uint32_t lanes) : lanes_(lanes & ((1u << kLanes) - 1)) {}
  constexpr Iterator begin() const { return Iterator(lanes_); }
  static constexpr Iterator end() { return Iterator(0); }

 private:
  std::uint32_t lanes_;
};

// The lanes whose bits are set in `active`, for `for (const int lane : lanes_of(active))`. The loop may change
// `active`: it visits the lanes whose bits were set when it began.
constexpr LaneSet lanes_of(std::uint32_t active) {
  return LaneSet(active);
}

constexpr bool contains(std::uint32_t lanes, int lane) {
  return (lanes >> lane & 1u) != 0;
}

// Copies one lane of an array laid out [doubles / kLanes][kLanes], such as a tile or some of its rows.
inline void copy_lane(const double* from, double* to, std::size_t doubles, int lane) {
  for (std::size_t i = static_cast<std::size_t>(lane); i < doubles; i += kLanes) to[i] = from[i];
}

}  // namespace shearbus::physics
