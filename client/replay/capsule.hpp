// shearbus-replay --capsule: repeats the failed step of one node alone.
#pragma once

#include <filesystem>

namespace shearbus::replay {

// Prints the capsule, and every reply column as recorded and as computed now. Returns false if any column differs in
// any bit. Throws for a file that is not a capsule.
bool run_capsule(const std::filesystem::path& file);

}  // namespace shearbus::replay
