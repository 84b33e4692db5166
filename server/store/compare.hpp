// Compares two checkpoints state by state and names the first session, node and quantity that differ.
#pragma once

#include <filesystem>
#include <string>

namespace shearbus::store {

// Returns an empty text if all sessions, and all offered nodes that no session has accepted, agree to the last bit;
// times and identities are not compared. Sessions are paired by id; one whose id is missing in the other file is paired
// with the first session that has the same scene and nodes. Throws std::runtime_error for a file that cannot be read,
// DamagedFile for a file that is not a sound checkpoint.
std::string first_difference(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace shearbus::store
