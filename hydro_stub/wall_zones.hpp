// What couples the mesh of a hydrocode and the layers of the service: the zones at the wall, that is next to the interface.
//
// A plastic layer, DLP (64), stands for the metal that moves with the interface node, which is half of the soft zone at
// the wall. Its thickness is therefore set from the mesh, for each node. With any other thickness the answer depends on
// the zones.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "hydro_stub/problem2d.hpp"
#include "hydro_stub/scene.hpp"

namespace shearbus::hydro {

// Returns half the thickness of the soft zones at each interface node, normal to the interface, at the start  [m].
std::vector<double> half_wall_zones(const lagrange::Bodies& bodies);

// Returns the thickness of each node's layer, `half_zone`, if the scene asks for a plastic layer; otherwise an empty list:
// the thickness is the scene's. Throws wire::Error{kInvalidScene} if the scene gives a plastic layer another thickness.
std::vector<double> plastic_layers(const SceneFile& file, std::vector<double> half_zone);

// Returns how strong the interface is compared to the soft metal; without the subgrid law the interface's own strength is
// absent.
InterfaceStrength interface_strength(const guest::HydroScene& scene, const physics::Material& soft);

// Returns the warning that a zone of thickness 2 `half_zone` [m] (half_wall_zones()) is about to melt under law (5) at
// `time` [s].
std::string melting_zone_warning(const guest::HydroScene& scene, double half_zone, double time);

}  // namespace shearbus::hydro
