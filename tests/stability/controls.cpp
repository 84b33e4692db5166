// The stability campaign judges the model by its invariants. The same invariants must find faults in solvers with
// deliberate errors.
#include <gtest/gtest.h>

#include <cstdio>

#include "tests/campaign/controls.hpp"

namespace shearbus::study::stability {
namespace {

TEST(Controls, EveryWrongSolverIsSeenToFailAndTheModelIsNot) {
  for (const Control& control : run_controls()) {
    const ControlOutcome& wrong = control.wrong;
    std::printf("%s: %d of %d steps broken, %s, hottest %.1f K\n", wrong.name.c_str(), wrong.broken, wrong.steps,
                wrong.rings ? "rings" : "does not ring", wrong.hottest);
    EXPECT_TRUE(control.seen()) << wrong.name << ": broken " << wrong.broken << " rings " << wrong.rings << " "
                                << wrong.first << "; model " << control.model.broken << " " << control.model.first
                                << " rings " << control.model.rings;
  }
}

}  // namespace
}  // namespace shearbus::study::stability
