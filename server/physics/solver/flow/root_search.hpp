// Finds the zero of a function inside a bracket, without derivatives: Chandrupatla's search (1997), inverse quadratic
// interpolation where it is reliable, else bisection. The caller supplies one value at a time, so the lanes of a tile
// search together.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/physics/material/elementary.hpp"

namespace shearbus::physics {

class RootSearch {
 public:
  RootSearch() = default;

  // The bracket has f(lo) = f_lo < 0 < f_hi = f(hi) and 0 <= lo < hi. `scale` is the size of f that counts as far from
  // zero: beyond it the search works on the logarithm of f, because f may be huge. A `guess` outside the bracket is not
  // used.
  RootSearch(double lo, double f_lo, double hi, double f_hi, double scale, double guess) : scale_(scale) {
    one_ = {lo, squeezed(f_lo)};
    two_ = {hi, squeezed(f_hi)};
    at_ = guess > lo && guess < hi ? guess : 0.5 * (lo + hi);
  }

  double at() const { return at_; }  // next argument of f; after update() has returned true, the zero of f

  // Tries `guess` next, if it lies inside the bracket and the search is young: a caller that knows more of f than its
  // values needs few of them.
  void prefer(double guess) {
    const double lo = std::min(one_.x, two_.x), hi = std::max(one_.x, two_.x);
    if (guess > lo && guess < hi && values_ < kMostPreferred) at_ = guess;
  }

  // `value` is f(at()). Returns true when the search has ended.
  bool update(double value) {
    const Point now{at_, squeezed(value)};
    if (now.f == 0.0) return true;
    if ((now.f < 0.0) == (one_.f < 0.0)) {
      three_ = one_;
    } else {
      three_ = two_;
      two_ = one_;
    }
    one_ = now;
    const double width = std::abs(two_.x - one_.x);
    const Point& nearest = std::abs(one_.f) < std::abs(two_.f) ? one_ : two_;
    // Smallest useful step of the argument.
    const double least = 2.0 * std::numeric_limits<double>::epsilon() * std::abs(nearest.x);
    if (width <= 2.0 * least || ++values_ == kMostValues) {
      at_ = nearest.x;
      return true;
    }
    double share = 0.5;
    const double xi = (one_.x - two_.x) / (three_.x - two_.x);
    const double phi = (one_.f - two_.f) / (three_.f - two_.f);
    // Every kBisectEvery-th step is a bisection, so that the search also ends soon where f is almost constant.
    if (values_ % kBisectEvery != 0 && phi * phi < xi && (1.0 - phi) * (1.0 - phi) < 1.0 - xi) {
      share = one_.f / (two_.f - one_.f) * (three_.f / (two_.f - three_.f)) +
              (three_.x - one_.x) / (two_.x - one_.x) * (one_.f / (three_.f - one_.f)) * (two_.f / (three_.f - two_.f));
    }
    const double shortest = least / width;
    if (!(share > shortest)) share = shortest;
    if (share > 1.0 - shortest) share = 1.0 - shortest;
    at_ = one_.x + share * (two_.x - one_.x);
    return false;
  }

 private:
  struct Point {
    double x = 0.0, f = 0.0;
  };
  static constexpr int kMostValues = 300;
  static constexpr int kMostPreferred = 8;
  static constexpr int kBisectEvery = 16;

  double squeezed(double f) const {
    const double size = std::abs(f) / scale_;
    const double small = size <= 1.0 ? size : 1.0 + logarithm(std::min(size, 1e300));
    return f < 0.0 ? -small : small;
  }

  double scale_ = 1.0;
  double at_ = 0.0;
  Point one_, two_, three_;  // the zero lies between one_ and two_; one_ is the newest
  int values_ = 0;
};

// The zero of f, whose values are given where the constructor of RootSearch asks for them.
template <class F>
double zero_between(double lo, double f_lo, double hi, double f_hi, double scale, double guess, const F& f) {
  RootSearch search(lo, f_lo, hi, f_hi, scale, guess);
  while (!search.update(f(search.at()))) {
  }
  return search.at();
}

}  // namespace shearbus::physics
