// The profiles of interface nodes across their layers that a scene asks for ([hydro.profiles]).
#pragma once

#include <cstddef>
#include <span>

#include "hydro_stub/interface_law.hpp"
#include "hydro_stub/scene.hpp"
#include "proto/files/profile_record.hpp"

namespace shearbus::hydro {

// The record of the profiles that the scene asks for, of a run with so many interface nodes. Reads the profiles once,
// so that what cannot be read is refused before the first step. Throws wire::Error.
files::ProfileRecord profile_record(const guest::HydroScene& scene, std::size_t nodes, InterfaceLaw& law);

// Adds the profiles that are due after a step to the record. `pressure`: of all interface nodes  [Pa].
void record_profiles(files::ProfileRecord& record, double time_s, std::span<const double> pressure, InterfaceLaw& law);

}  // namespace shearbus::hydro
