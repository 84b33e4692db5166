// A run of the problem cone_target from scene to results.
#pragma once

#include <filesystem>

#include "hydro_stub/cone_target.hpp"
#include "hydro_stub/interface_law.hpp"
#include "proto/wire/scene.hpp"

namespace shearbus::hydro {

// Leaves interface.h5 (histories of the interface nodes), free_surface.h5, fields.h5 with fields.xmf, and summary.json
// in `out`, and prints the summary. Throws wire::Error or std::exception, and then leaves no file that looks whole.
void run_cone_target(const wire::Scene& scene, const ConeTarget& problem, lagrange::Bodies bodies, InterfaceLaw& law,
                     const std::filesystem::path& out, bool progress);

}  // namespace shearbus::hydro
