// Friction laws that the server's administrator has loaded, by the name of "own:NAME". Filled before the first scene is
// read, never changed later; a client cannot add one.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "server/physics/interface/friction_law.h"

namespace shearbus::service {

// `law` must live as long as the process. A name that exists already is replaced.
void offer_own_law(std::string name, const shearbus_friction_law* law);
const shearbus_friction_law* own_law(std::string_view name);  // null: there is none
std::vector<std::string> own_law_names();

}  // namespace shearbus::service
