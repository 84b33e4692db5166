// Events that inputs of the fuzz target `service` contain in addition to requests.
#pragma once

#include <string>

namespace shearbus::fuzz {

inline const std::string kCheckpointEvent = "C";
inline const std::string kRestartEvent = "R";

}  // namespace shearbus::fuzz
