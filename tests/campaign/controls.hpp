// Negative controls of the stability campaign: small solvers with known errors, which answer in place of the model and
// are held to the same invariants. If one passed, the campaign could not detect its error.
#pragma once

#include <string>
#include <vector>

namespace shearbus::study::stability {

struct ControlOutcome {
  std::string name;
  std::string what;  // its error
  int steps = 0;
  int broken = 0;        // steps that broke an invariant
  std::string first;     // first of these steps
  bool rings = false;    // s, [V] or T0 alternates
  double factor = 0.0;   // ratio of the last change to the one before, if it rings
  double hottest = 0.0;  // T0 reached  [K]

  bool fails() const { return broken > 0 || rings; }
};

// Outcomes of a wrong solver and of the model on the same inputs.
struct Control {
  ControlOutcome wrong, model;
  bool must_ring;  // true: must ring; false: must break an invariant
  bool seen() const { return (must_ring ? wrong.rings : wrong.broken > 0) && !model.fails(); }
};
std::vector<Control> run_controls();

}  // namespace shearbus::study::stability
