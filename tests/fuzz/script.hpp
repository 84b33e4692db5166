// Events other than requests that an input of the fuzz target `service` may contain.
#pragma once

#include <string>

namespace shearbus::fuzz {

inline const std::string kCheckpointEvent = "C";
inline const std::string kRestartEvent = "R";

}  // namespace shearbus::fuzz
