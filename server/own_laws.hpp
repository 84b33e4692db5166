// Loads the friction laws that an administrator gives the server (physics/interface/friction_law.h).
#pragma once

#include <string>
#include <vector>

namespace shearbus::server {

// What one --friction-law names. Throws wire::Error unless it is NAME=FILE.
struct OwnLaw {
  std::string name, file;
};
OwnLaw own_law_of(const std::string& given);

// Each of `laws` is NAME=FILE. Offers the law of the shared library FILE to scenes as "own:NAME". Throws wire::Error for a
// file that is no such library.
void load_own_laws(const std::vector<std::string>& laws);

}  // namespace shearbus::server
