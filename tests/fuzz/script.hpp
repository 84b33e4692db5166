// Events in inputs of the target `service`, in addition to requests.
#pragma once

#include <string>

namespace shearbus::fuzz {

inline const std::string kCheckpointEvent = "C";
inline const std::string kRestartEvent = "R";

}  // namespace shearbus::fuzz
