// Negative controls of the stability campaign: small solvers with known errors, which replace the model and are checked
// against the same invariants. If such a solver passed, the campaign would be unable to detect its error.
#pragma once

#include <string>
#include <vector>

namespace shearbus::study::stability {

struct ControlOutcome {
  std::string name;
  std::string what;  // the error that the wrong solver makes, in a few words
  int steps = 0;
  int broken = 0;        // number of steps that broke an invariant
  std::string first;     // message of the first step that broke an invariant
  bool rings = false;    // the watched quantity (stress, velocity jump or T0) alternates
  double factor = 0.0;   // if `rings`: ratio of the last change of the watched quantity to the change before
  double hottest = 0.0;  // highest interface temperature T0 of the run  [K]

  bool fails() const { return broken > 0 || rings; }
};

// The outcomes of one wrong solver, and of the correct model on the same inputs.
struct Control {
  ControlOutcome wrong, model;
  bool must_ring;  // true: the wrong solver must ring; false: it must break an invariant
  bool seen() const { return (must_ring ? wrong.rings : wrong.broken > 0) && !model.fails(); }
};
std::vector<Control> run_controls();

}  // namespace shearbus::study::stability
