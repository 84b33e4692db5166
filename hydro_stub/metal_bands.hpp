// The displacement of metal against metal over bands around an interface: of two material points that face each other
// at the start, one in the soft and one in the hard body, each at a distance d from the interface. It contains the slip
// and the shear of both metals within the band. Where the metal shears in place of the interface, it is this displacement
// that converges as zones get narrower; the slip tends to 0.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include "hydro_stub/lagrange/cycle.hpp"

namespace shearbus::hydro {

class MetalBands {
 public:
  static constexpr std::array<double, 2> kDistances = {0.5e-3, 1e-3};  // distances d of the points  [m]

  explicit MetalBands(const lagrange::Bodies& bodies);

  // Returns the velocity of the soft point less that of the hard point along the tangent of interface node i  [m/s]; 0
  // if a body is thinner than the band there.
  double velocity_difference(const lagrange::Cycle& cycle, std::size_t band, std::size_t i) const;
  // Whether both bodies reach as far as band `band` at interface node i.
  bool reaches(std::size_t band, std::size_t i) const { return points_[band][i].has_value(); }

 private:
  // A material point of a zone, by the shape functions of the zone's nodes.
  struct Point {
    std::array<int, 4> node;
    std::array<double, 4> weight;
  };
  struct Pair {
    Point soft, hard;
  };

  std::array<std::vector<std::optional<Pair>>, kDistances.size()> points_;
};

}  // namespace shearbus::hydro
