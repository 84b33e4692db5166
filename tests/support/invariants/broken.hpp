// The failure of an invariant, and the check that throws it.
#pragma once

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

namespace shearbus::testing {

// Exception: an invariant does not hold.
class Broken : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Throws Broken unless `held`. Conditions must be written so that they are false for a NaN.
template <class... Args>
void require(bool held, fmt::format_string<const Args&...> text, const Args&... args) {
  if (!held) throw Broken(fmt::format(text, args...));
}
inline void require_near(double value, double expected, double tolerance, const char* what) {
  require(std::abs(value - expected) <= tolerance, "{}: {:.17g} instead of {:.17g}, more than {:.3g} apart", what,
          value, expected, tolerance);
}

}  // namespace shearbus::testing
