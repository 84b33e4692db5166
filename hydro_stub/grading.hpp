// Zones graded towards an interface: thin next to it, growing away from it. Only the thickness normal to the interface
// is graded.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace shearbus::hydro {

struct Grading {
  double first = 0.0;   // thickness of the zone at the interface  [m]
  double growth = 1.2;  // ratio of the thicknesses of neighbouring zones, at least 1
  double widest = 0.0;  // thickness at which the zones stop growing  [m]
};

// The nodes of a graded body, by their distances from its interface.
struct GradedNodes {
  std::vector<double> distance;  // from 0 to the length of the body, increasing  [m]
  // distance[0] to distance[graded] are those of growing zones; the zones after them are equal and fill the body
  std::size_t graded = 0;
};

// Divides a body of a given length. The last growing zone is at most as thick as half of what then remains.
GradedNodes graded_nodes(double length, const Grading& grading);

// Returns the grading of a problem whose keys are `table`.first_zone_m (if `has_first`) and .zone_growth, and whose other
// zones are `widest`. `longest` is the length of the longest body normal to the interface. Throws
// wire::Error{kInvalidScene} that names the key at fault.
Grading checked_grading(const std::string& table, bool has_first, double first, double growth, double widest,
                        double longest);

}  // namespace shearbus::hydro
