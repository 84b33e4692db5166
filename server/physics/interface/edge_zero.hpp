// The zero of the spare strength H(a) = s_lim(T0(a), v(a)) - a that comes first from one end of an interval of stresses,
// of however many: from the left the answer with the most slip. No scan: a step of the search is made only where the
// limit at the ends of the step proves that H has no zero between them (Slip, friction.hpp).
#pragma once

#include "server/physics/interface/stress_limit.hpp"

namespace shearbus::physics {

// A stress, and the temperature and slip velocity of the interface under it. The slip falls with the stress.
struct SlipPoint {
  double a, T, v;
};

class EdgeZero {
 public:
  static constexpr double kSame = 1e-6;  // zeros closer together than this, relative to the stress, count as one

  EdgeZero() = default;
  // Searches from `from` towards `to`. `hottest`: the point of the highest temperature; to its left T rises with the
  // stress, to its right it falls.
  EdgeZero(const StressLimit& limit, const SlipPoint& from, const SlipPoint& to, const SlipPoint& hottest);

  bool done() const { return done_; }
  double at() const { return at_; }  // the stress at which update() needs the point
  void update(const SlipPoint& point);
  bool found() const { return found_; }
  // The zero; without one the end `to`. A point that update() was given, or an end. Its stress is NaN where a law gave
  // no number.
  const SlipPoint& answer() const { return answer_; }
  // Of a search from the left: the largest stress that update() was given at which the interface could carry more.
  const SlipPoint& below() const { return below_; }

 private:
  double value(const SlipPoint& p) const { return bound(p, p); }
  // A lower bound of the (signed) spare strength from `edge` to `p`.
  double bound(const SlipPoint& edge, const SlipPoint& p) const;
  bool is_next_to_from(const SlipPoint& p) const;
  void cap(const SlipPoint& point, double f);
  void go_on();
  void end(const SlipPoint& at, bool found);

  const StressLimit* limit_ = nullptr;
  SlipPoint from_{}, to_{}, hottest_{}, cap_{}, answer_{}, below_{};  // no zero lies between the start and from_
  double f_from_ = 0.0, f_to_ = 0.0;      // signed spare strengths: that of from_ is positive
  double f_cap_ = 0.0, cap_bound_ = 0.0;  // at cap_: spare strength, and its bound from from_ on
  double sign_ = 1.0;
  double at_ = 0.0;
  bool found_ = false;   // a zero lies between from_ and to_
  bool capped_ = false;  // H has one sign at from_ and cap_, and may have zeros between them
  bool moved_from_ = false;
  bool done_ = false;
  int steps_ = 0;
};

}  // namespace shearbus::physics
