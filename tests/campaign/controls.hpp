// Negative controls of the stability campaign: solvers that are known to be wrong, each small, answering in place of
// the model and held to the same invariants. A campaign in which they passed could not fail.
#pragma once

#include <string>
#include <vector>

namespace shearbus::study::stability {

struct ControlOutcome {
  std::string name;
  std::string what;  // what it does wrong
  int steps = 0;
  int broken = 0;        // steps that broke an invariant
  std::string first;     // the first of them
  bool rings = false;    // s, [V] or T0 alternates by itself
  double factor = 0.0;   // of the last change to the one before, where it rings
  double hottest = 0.0;  // T0 reached  [K]

  bool fails() const { return broken > 0 || rings; }
};

// Each wrong solver, and the model on the same inputs, judged in the same way.
struct Control {
  ControlOutcome wrong, model;
  bool must_ring;  // or else break an invariant
  bool seen() const { return (must_ring ? wrong.rings : wrong.broken > 0) && !model.fails(); }
};
std::vector<Control> run_controls();

}  // namespace shearbus::study::stability
