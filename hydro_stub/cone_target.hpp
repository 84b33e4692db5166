// The problem `cone_target` of a scene: a light cone in a heavy confinement, struck by a flyer (the dynamic friction
// experiment of DLP section 2, Fig. 6). Axisymmetric, z along the axis:
//
//      z
//      |___________ back radius, free surface
//      |          \ |               |
//      |   cone    \|  confinement  |     the cone's flank slides along the confinement: the interface
//      |____________\_______________|     front radius, z = 0
//      |                            |
//      |           flyer    ^       |
//      |____________________|_______|
#pragma once

#include "hydro_stub/metal.hpp"
#include "hydro_stub/problem2d.hpp"

namespace shearbus::hydro {

struct ConeTarget {
  guest::ConeTarget scene;
  double end_time = 0.0;  // [s]
  Metal soft, hard;
  std::optional<HeatBound> heat_bound = {};  // with the subgrid law, whose interface stays below melting

  // Indices of the three bodies among the blocks of the mesh.
  static constexpr int kCone = 0;
  static constexpr int kConfinement = 1;
  static constexpr int kFlyer = 2;
};

// Reads the problem `cone_target` of a scene. Throws wire::Error{kInvalidScene} that names the field at fault.
ConeTarget make_cone_target(const guest::HydroScene& scene);

// Makes the three bodies of the problem: mesh, materials, walls and slide lines. The interface law acts on the cone's
// flank; cone and confinement slip freely along the flyer.
lagrange::Bodies make_bodies(const ConeTarget& problem);

// Makes the two-dimensional problem of a cone target: bodies, metals, end time and what the run records.
Problem2d make_problem2d(const ConeTarget& problem);

}  // namespace shearbus::hydro
