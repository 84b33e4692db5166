// Boundary conditions of the bodies: walls with a given normal velocity, and pressure loads.
#pragma once

#include <vector>

#include "hydro_stub/lagrange/mesh.hpp"

namespace shearbus::lagrange {

// A wall constrains its nodes to v . normal = speed. With speed 0 it is a plane of symmetry, otherwise a piston. Walls
// that share nodes must be at right angles.
struct Wall {
  std::vector<int> nodes;
  Vec2 normal;         // unit vector
  double speed = 0.0;  // velocity of the wall along `normal`  [m/s]
};

// A given pressure on a polyline of boundary nodes with the body on its left.
struct PressureLoad {
  std::vector<int> nodes;
  double pressure = 0.0;  // [Pa]
};

// Returns the force of the pressure load on each of the load's nodes.
std::vector<Vec2> pressure_forces(const Mesh& mesh, const PressureLoad& load, const std::vector<Vec2>& position);

// Projects vectors of nodes onto the directions that the walls leave free.
class Guides {
 public:
  Guides(int num_nodes, const std::vector<Wall>& walls);
  Vec2 free_part(int node, Vec2 v) const {
    const Normals& n = normals_[node];
    v -= dot(v, n.first) * n.first;
    v -= dot(v, n.second) * n.second;
    return v;
  }

 private:
  struct Normals {
    // unit normals of the one or two walls that the node lies on; a zero vector stands for no wall
    Vec2 first, second;
  };
  std::vector<Normals> normals_;
};

}  // namespace shearbus::lagrange
