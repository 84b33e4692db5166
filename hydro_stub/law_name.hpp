#pragma once

#include "hydro_stub/hydro.pb.h"

namespace shearbus::hydro {

// Returns the name of the law in scenes: "subgrid", "coulomb_tresca", "free_slip", "stick", "constant".
inline const char* name(guest::InterfaceLaw law) {
  switch (law) {
    case guest::INTERFACE_LAW_COULOMB_TRESCA:
      return "coulomb_tresca";
    case guest::INTERFACE_LAW_FREE_SLIP:
      return "free_slip";
    case guest::INTERFACE_LAW_STICK:
      return "stick";
    case guest::INTERFACE_LAW_CONSTANT:
      return "constant";
    default:
      break;
  }
  return "subgrid";
}

}  // namespace shearbus::hydro
