// The errors of a convergence test under refinement: a table that is printed as it grows, and the order in each row.
// The title tells what is refined and the error of what.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

namespace shearbus::testing {

// Each row halves the step or the cells of the row before: its error must be smaller by 2^order, within `within` of the
// exponent; kMore allows any larger order.
class Orders {
 public:
  enum Upwards { kExact, kMore };

  Orders(const char* title, double order, double within, Upwards upwards = kExact)
      : title_(title), order_(order), within_(within), upwards_(upwards) {}

  // `refinement` is a step length, a number of steps or of cells. The order is expected from the second row on, where
  // `expected` is true.
  void add(double refinement, double error, bool expected = true) {
    const double order = before_ != 0.0 ? std::log2(before_ / error) : NAN;
    std::printf("%9.4g  error %11.4e  order %6.3f  %s\n", refinement, error, order, title_);
    if (before_ != 0.0 && expected) {
      EXPECT_GE(order, order_ - within_) << title_ << ", at " << refinement;
      if (upwards_ == kExact) {
        EXPECT_LE(order, order_ + within_) << title_ << ", at " << refinement;
      }
    }
    before_ = error;
  }

  double last() const { return before_; }

 private:
  const char* title_;
  double order_, within_;
  Upwards upwards_;
  double before_ = 0.0;
};

}  // namespace shearbus::testing
