// A run from scene to results.
#pragma once

#include <memory>
#include <string>

#include "hydro_stub/interface_law.hpp"
#include "hydro_stub/options.hpp"
#include "hydro_stub/problem.hpp"
#include "proto/wire/scene.hpp"

namespace shearbus::hydro {

// "subgrid", "coulomb_tresca".
const char* name(wire::InterfaceLaw law);

// The scene's law for the problem's columns. Says on stderr what the server warns of. Throws wire::Error.
std::unique_ptr<InterfaceLaw> make_law(const wire::Scene& scene, const Problem& problem, const std::string& endpoint);

// Steps through the problem; leaves history.h5 and summary.json in `out` and prints the summary. Throws wire::Error or
// std::exception, and then leaves no file that looks whole.
void run(const wire::Scene& scene, const Problem& problem, InterfaceLaw& law, const std::filesystem::path& out,
         bool progress);

// Pictures of out/history.h5 beside it, by plot_histories.py. Throws std::runtime_error where it fails.
void plot(const std::filesystem::path& out);

}  // namespace shearbus::hydro
