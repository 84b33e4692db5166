// Runs a scene and writes its results.
#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include "hydro_stub/interface_law.hpp"
#include "hydro_stub/problem.hpp"
#include "hydro_stub/scene.hpp"
#include "hydro_stub/subgrid_law.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {

// Makes the interface law of the scene, for nodes with these initial temperatures (without nodes: free slip, and no
// session) and layers of this thickness (empty: the scene's), or restores it from `kept`, the text that
// InterfaceLaw::keep() returned. Prints the server's warnings to stderr. Throws wire::Error.
std::unique_ptr<InterfaceLaw> make_law(const SceneFile& file, const physics::Material& soft,
                                       const physics::Material& hard, std::span<const double> initial_temperature,
                                       std::span<const double> layer_thickness, const SubgridServer& server,
                                       const std::string& kept = {});

// Runs the problem of `scene`, which has all constants and the time step filled in, writes history.h5 and summary.json to
// `out` and prints the summary. Throws wire::Error or std::exception; if a step fails, no file has the name of a complete
// result.
void run(const guest::HydroScene& scene, const ColumnProblem& problem, InterfaceLaw& law,
         const std::filesystem::path& out, const server::Entries& provenance, bool progress);

// Draws the results in `out` with plot_histories.py or plot_cone.py. Throws std::runtime_error if that fails.
void plot(const std::filesystem::path& out, bool cone = false);

}  // namespace shearbus::hydro
