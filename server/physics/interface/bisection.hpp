// The last two numbers between which a condition changes.
#pragma once

namespace shearbus::physics {

struct Bracket {
  double lo, hi;
};

// Halves the bracket until no number lies between its ends. `above(x)`: false at `lo`, true at `hi`.
template <class Above>
Bracket bisected(double lo, double hi, const Above& above) {
  for (double mid = 0.5 * (lo + hi); mid > lo && mid < hi; mid = 0.5 * (lo + hi)) (above(mid) ? hi : lo) = mid;
  return {lo, hi};
}

}  // namespace shearbus::physics
