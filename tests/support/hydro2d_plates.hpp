// Two elastic plates, of the aluminium and the steel of the DLP paper, on a slide line: sliding problems with exact
// solutions.
#pragma once

#include "tests/support/hydro2d.hpp"

namespace shearbus::test {

struct Plates : hydro::PlatesProblem {
  Plates()
      : PlatesProblem{.soft = plastic_metal(aluminium_6061(), 27.6e9, 1e12),
                      .hard = plastic_metal(steel_304(), 77e9, 1e12)} {}
};

inline Bodies plates(const Plates& p) {
  return make_bodies(p);
}

}  // namespace shearbus::test
