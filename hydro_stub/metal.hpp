// A metal of the hydrocode: the strength constants that the shear layer uses too, and an equation of state.
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

// Makes the metal of a body, whose table in the scene is [table]. A constant of the equation of state is the value in
// `other` if there is one, otherwise the value of the body's material. Throws wire::Error if both are missing.
Metal make_metal(const v1::Body& body, const std::string& table, const guest::MieGrueneisen& other = {});

inline lagrange::BodyMaterial body_material(const Metal& metal) {
  return {.eos = lagrange::Eos(metal.eos), .strength = metal.strength};
}

// Gives all zones and nodes of a block the same density, energy and velocity.
void fill(lagrange::Bodies& bodies, const lagrange::Block& block, double density, double energy,
          lagrange::Vec2 velocity);

}  // namespace shearbus::hydro
