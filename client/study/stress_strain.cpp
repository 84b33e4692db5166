#include "client/study/stress_strain.hpp"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

#include "server/physics/material/strength.hpp"
#include "server/service/scene_model.hpp"
#include "tests/campaign/user_scene.hpp"

namespace shearbus::study {
namespace {

constexpr double kMostIncrement = 1e-3;  // of plastic strain; halving it changes a stress by less than 1e-6 of itself
constexpr double kMostStrain = 100.0;    // far beyond what a press or a bar does to a metal

}  // namespace

std::vector<CurvePoint> stress_strain(const physics::Material& metal, const CurveOptions& options) {
  const double heat_per_work = options.taylor_quinney / (metal.density * metal.specific_heat);  // [K/(J/m3)]
  const auto stress = [&](double strain, double T) {
    return physics::flow_stress(metal, strain, 0.0, T, options.rate);
  };
  std::vector<CurvePoint> points;
  double strain = 0.0, T = options.temperature;
  for (const double wanted : options.strains) {
    if (!(wanted >= strain))
      throw std::runtime_error(fmt::format("--plastic-strain {}: expected strains that rise from 0", wanted));
    const int parts = static_cast<int>(std::ceil((wanted - strain) / kMostIncrement));
    const double dep = parts > 0 ? (wanted - strain) / parts : 0.0;
    for (int i = 0; i < parts; ++i) {
      const double T_middle = T + 0.5 * dep * heat_per_work * stress(strain, T);
      T += dep * heat_per_work * stress(strain + 0.5 * dep, T_middle);
      strain += dep;
    }
    strain = wanted;
    points.push_back({strain, stress(strain, T), T});
  }
  return points;
}

CLI::App* add_curve(CLI::App& program, CurveOptions& options) {
  CLI::App* command = program.add_subcommand(
      "curve", "Stress against plastic strain of a scene's soft metal at a constant rate, as CSV in SI units");
  command->add_option("scene", options.scene, "a scene; its soft metal counts")->required()->check(CLI::ExistingFile);
  command->add_option("--rate", options.rate, "plastic strain rate, 1/s")->required()->check(CLI::NonNegativeNumber);
  command->add_option("--temperature", options.temperature, "at the start, K")->required()->check(CLI::PositiveNumber);
  command
      ->add_option("--taylor-quinney", options.taylor_quinney,
                   "fraction of the plastic work that heats the metal; 0: isothermal")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--plastic-strain", options.strains, "at which the stress is wanted, rising, with commas between")
      ->required()
      ->delimiter(',')
      ->check(CLI::Range(0.0, kMostStrain));
  return command;
}

void run_curve(const CurveOptions& options) {
  const physics::Material metal = service::scene_model(load_scene_with_layer(options.scene).scene.scene()).options.soft;
  fmt::print("plastic_strain,stress_pa,temperature_k\n");
  for (const CurvePoint& point : stress_strain(metal, options))
    fmt::print("{},{:.9g},{:.6f}\n", point.plastic_strain, point.stress, point.temperature);
}

}  // namespace shearbus::study
