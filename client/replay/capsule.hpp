// shearbus-replay --capsule: a node that had no answer, run again alone.
#pragma once

#include <filesystem>

namespace shearbus::replay {

// Prints what the capsule holds, and every column as it was recorded and as it is found now. False where one differs,
// be it in the last bit. Throws where the file is no capsule.
bool run_capsule(const std::filesystem::path& file);

}  // namespace shearbus::replay
