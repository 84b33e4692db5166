// The subcommand `curve` of shearbus-study: stress against strain of a scene's soft metal, as a press or a Hopkinson bar
// measures it.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <vector>

#include "server/physics/material/material.hpp"

namespace shearbus::study {

struct CurveOptions {
  std::filesystem::path scene;
  double rate = 0.0;            // plastic strain rate, constant  [1/s]
  double temperature = 300.0;   // at the start  [K]
  double taylor_quinney = 0.0;  // fraction of the plastic work that heats the metal; 0: isothermal
  std::vector<double> strains;  // plastic strains at which the stress is wanted, rising
};

struct CurvePoint {
  double plastic_strain, stress, temperature;  // [-], [Pa], [K]
};

CLI::App* add_curve(CLI::App& program, CurveOptions& options);
void run_curve(const CurveOptions& options);

// Uniaxial stress without pressure: rho c dT = X Y(ep, rate, T) dep, by the midpoint rule in equal parts of at most
// kMostIncrement. Throws std::runtime_error for strains that do not rise from 0.
std::vector<CurvePoint> stress_strain(const physics::Material& metal, const CurveOptions& options);

}  // namespace shearbus::study
