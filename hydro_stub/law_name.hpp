#pragma once

#include "proto/wire/scene.hpp"

namespace shearbus::hydro {

// As scenes write it: "subgrid", "coulomb_tresca", "free_slip", "stick", "constant".
inline const char* name(wire::InterfaceLaw law) {
  switch (law) {
    case wire::InterfaceLaw::kCoulombTresca:
      return "coulomb_tresca";
    case wire::InterfaceLaw::kFreeSlip:
      return "free_slip";
    case wire::InterfaceLaw::kStick:
      return "stick";
    case wire::InterfaceLaw::kConstant:
      return "constant";
    case wire::InterfaceLaw::kSubgrid:
    case wire::InterfaceLaw::kUnspecified:
      break;
  }
  return "subgrid";
}

}  // namespace shearbus::hydro
