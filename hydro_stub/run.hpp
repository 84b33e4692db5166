// A run from scene to results.
#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include "hydro_stub/interface_law.hpp"
#include "hydro_stub/law_name.hpp"
#include "hydro_stub/problem.hpp"
#include "hydro_stub/scene.hpp"
#include "hydro_stub/subgrid_law.hpp"

namespace shearbus::hydro {

// The scene's law for nodes with these initial temperatures; with `kept` (InterfaceLaw::keep) as it was when that was
// said. Says on stderr what the server warns of. Throws wire::Error.
std::unique_ptr<InterfaceLaw> make_law(const SceneFile& file, const physics::Material& soft,
                                       const physics::Material& hard, std::span<const double> initial_temperature,
                                       const SubgridServer& server, const std::string& kept = {});

// Steps through the problem; leaves history.h5 and summary.json in `out` and prints the summary. Throws wire::Error or
// std::exception, and then leaves no file that looks whole.
void run(const guest::HydroScene& scene, const Problem& problem, InterfaceLaw& law, const std::filesystem::path& out,
         bool progress);

// Pictures beside the results in `out`: of history.h5 by plot_histories.py, of a cone's by plot_cone.py. Throws
// std::runtime_error where it fails.
void plot(const std::filesystem::path& out);
void plot_cone(const std::filesystem::path& out);

}  // namespace shearbus::hydro
