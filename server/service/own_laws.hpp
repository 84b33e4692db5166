// Friction laws that the server's administrator has loaded, by the name of "own:NAME". Filled before the first scene is
// read, never changed later; a client cannot add one.
#pragma once

#include <functional>
#include <map>
#include <string>

#include "server/physics/interface/friction_law.h"

namespace shearbus::service {

// The laws live as long as the process.
inline std::map<std::string, const shearbus_friction_law*, std::less<>>& own_laws() {
  static std::map<std::string, const shearbus_friction_law*, std::less<>> all;
  return all;
}

}  // namespace shearbus::service
