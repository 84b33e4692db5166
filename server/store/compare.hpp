// Two checkpoints, state by state: which session, node and quantity is the first that differs.
#pragma once

#include <filesystem>
#include <string>

namespace shearbus::store {

// Empty: the sessions are the same to the last bit, times and identities apart. Sessions are paired by their ids; one
// whose id the other file does not have, with the first that has its scene and nodes. Throws std::runtime_error for
// files that cannot be read, DamagedFile for those that are no sound checkpoints.
std::string first_difference(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace shearbus::store
