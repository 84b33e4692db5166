#include "server/physics/interface/edge_zero.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace shearbus::physics {
namespace {

constexpr int kMostSteps = 400;
constexpr double kDigits = 2.0 * std::numeric_limits<double>::epsilon();
constexpr int kBisectEvery = 4;           // every so many steps bisect, so that the search ends also where H is a step
constexpr double kStepWithinBound = 0.9;  // share of the step that would just be proven

}  // namespace

EdgeZero::EdgeZero(const StressLimit& limit, const SlipPoint& from, const SlipPoint& to, const SlipPoint& hottest)
    : limit_(&limit), from_(from), to_(to), hottest_(hottest), sign_(from.a <= to.a ? 1.0 : -1.0) {
  f_from_ = value(from_);
  f_to_ = value(to_);
  if (!(f_from_ > 0.0) || std::isnan(f_to_)) {
    if (std::isnan(f_from_ + f_to_)) from_.a = std::numeric_limits<double>::quiet_NaN();
    end(from_, true);
    return;
  }
  found_ = f_to_ <= 0.0;
  if (!found_) cap(to_, f_to_);
  // A limit that vanishes without slip may hold up to the last digits before it.
  if (found_ && f_to_ == -to_.a && to_.a > 0.0 && sign_ > 0.0) {
    at_ = to_.a * (1.0 - 2.0 * kDigits);
    return;
  }
  go_on();
}

double EdgeZero::bound(const SlipPoint& edge, const SlipPoint& p) const {
  double T = sign_ > 0.0 ? std::max(edge.T, p.T) : std::min(edge.T, p.T);
  if (sign_ > 0.0 && edge.a < hottest_.a && hottest_.a < p.a) T = hottest_.T;
  if (limit_->effort != nullptr) ++limit_->effort->limit_values;
  return sign_ * (limit_->at(T, {p.v, edge.v}).stress - p.a);
}

bool EdgeZero::is_next_to_from(const SlipPoint& p) const {
  return std::abs(p.a - from_.a) <= kSame * std::max(p.a, from_.a);
}

void EdgeZero::cap(const SlipPoint& point, double f) {
  cap_ = point;
  f_cap_ = f;
  cap_bound_ = is_next_to_from(point) ? f : bound(from_, point);
  capped_ = true;
}

void EdgeZero::end(const SlipPoint& at, bool found) {
  answer_ = at;
  found_ = found;
  done_ = true;
}

void EdgeZero::update(const SlipPoint& point) {
  const double f = value(point);
  if (f > 0.0 && point.a > below_.a) below_ = point;
  if (std::abs(f) <= kDigits * point.a) return end(point, true);
  if (std::isnan(f)) return end({f, f, f}, true);
  if (!(f > 0.0)) {
    // The zero of a search that halves one end again and again: the other end counts less (the Illinois method).
    if (!moved_from_ && found_) f_from_ *= 0.5;
    moved_from_ = false;
    to_ = point;
    f_to_ = f;
    found_ = true;
    capped_ = false;
  } else {
    const SlipPoint before = cap_;
    const double f_before = f_cap_;
    const bool was_capped = capped_;
    cap(point, f);
    if (cap_bound_ > 0.0) {
      if (moved_from_ && found_) f_to_ *= 0.5;
      moved_from_ = true;
      from_ = point;
      f_from_ = f;
      capped_ = false;
      if (was_capped) cap(before, f_before);
    }
  }
  go_on();
}

void EdgeZero::go_on() {
  if (capped_ && cap_bound_ > 0.0) {
    capped_ = false;
    from_ = cap_;
    f_from_ = f_cap_;
  }
  if (!found_ && !capped_) {
    if (from_.a == to_.a) return end(to_, false);
    cap(to_, f_to_);
    if (cap_bound_ > 0.0) return end(to_, false);
  }
  const double width = (capped_ ? cap_.a : to_.a) - from_.a;
  if (std::abs(width) <= kDigits * std::max(from_.a, to_.a) || ++steps_ == kMostSteps) return end(to_, found_);
  double share = 0.5;
  if (capped_) {
    // The proven step ends where the bound, which is not positive at the cap, is 0.
    share = std::clamp(kStepWithinBound * f_from_ / (f_from_ - cap_bound_), 0.01, kStepWithinBound);
  } else if (steps_ % kBisectEvery != 0) {
    share = f_from_ / (f_from_ - f_to_);
  }
  if (!(share > 0.0 && share < 1.0)) share = 0.5;
  const double next = from_.a + share * width;
  at_ = next != from_.a && next != from_.a + width ? next : from_.a + 0.5 * width;
}

}  // namespace shearbus::physics
