// What inputs of the target `service` are made of beside requests.
#pragma once

#include <string>

namespace shearbus::fuzz {

inline const std::string kCheckpointEvent = "C";
inline const std::string kRestartEvent = "R";

}  // namespace shearbus::fuzz
