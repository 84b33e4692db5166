// The guest's tables of a scene, value <-> message. Private to the scene's own sources.
#pragma once

#include "proto/wire/scene.hpp"
#include "shearbus/v1/hydro.pb.h"

namespace shearbus::wire {

// An enum of the message as a value; `fallback` is what its rule calls the default.
template <typename Enum, typename Wire>
Enum enum_or(Wire wire, Enum fallback) {
  return wire == Wire{} ? fallback : static_cast<Enum>(wire);
}

void hydro_to_message(const Hydro& hydro, v1::Hydro& message);
Hydro hydro_from_message(const v1::Hydro& message);  // whose defaults are filled in

}  // namespace shearbus::wire
