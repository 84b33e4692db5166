// A metal as the hydrocode needs it: the shear layer's strength, and the equation of state that goes with it.
#pragma once

#include <string>

#include "hydro_stub/hydro.pb.h"
#include "hydro_stub/lagrange/cycle.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::hydro {

struct Metal {
  lagrange::MieGrueneisen eos;
  physics::Material strength;
};

// The body of [table] with the equation of state its constants say, or those of `other` in their place. Refuses what is
// missing.
Metal make_metal(const v1::Body& body, const std::string& table, const guest::MieGrueneisen& other = {});

inline lagrange::BodyMaterial body_material(const Metal& metal) {
  return {.eos = lagrange::Eos(metal.eos), .strength = metal.strength};
}

// The same state all over a block.
void fill(lagrange::Bodies& bodies, const lagrange::Block& block, double density, double energy,
          lagrange::Vec2 velocity);

}  // namespace shearbus::hydro
