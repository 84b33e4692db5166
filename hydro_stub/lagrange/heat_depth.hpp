// The depth that friction heat has reached in metal that conducts, for zones that do not: on zones thinner than this
// depth, friction heat is spread over several of them, and the temperature of the interface is a mean over them. The depth
// is max(dz, sqrt(alpha t)), with the thickness dz of the zone at the wall, the diffusivity alpha and the time t of
// friction. This is ours, not the paper's: a zone that keeps all the heat melts if it is thin.
#pragma once

#include <vector>

#include "hydro_stub/lagrange/slide_line.hpp"

namespace shearbus::lagrange {

class HeatDepth {
 public:
  // `soft`, `hard`: thermal diffusivities of the bodies  [m2/s]
  HeatDepth(const Mesh& mesh, const std::vector<SlideLine>& lines, double soft, double hard);

  // Adds `heat` [J] to the zones at and behind a wall zone after `time` [s] of friction.
  void give(int wall_zone, double heat, double time, const std::vector<double>& mass,
            std::vector<double>& energy) const;
  // Returns the mean of a quantity of the zones over the depth.
  double mean(int wall_zone, double time, const std::vector<double>& quantity) const;

 private:
  struct Behind {
    double diffusivity = 0.0;       // [m2/s]
    std::vector<int> zones;         // the wall zone, then the zones behind it
    std::vector<double> thickness;  // of each, normal to the wall, at the start  [m]
  };
  void add(const Mesh& mesh, const Surface& surface, double diffusivity);
  // Calls each(zone, share) for the zones within the depth; the shares sum to 1.
  template <class Each>
  void spread(int wall_zone, double time, const Each& each) const;

  std::vector<Behind> walls_;
  std::vector<int> wall_of_zone_;  // index in walls_, or -1
};

}  // namespace shearbus::lagrange
