#include "hydro_stub/layer_start.hpp"

#include <fmt/format.h>

#include "hydro_stub/problem.hpp"
#include "hydro_stub/scene.hpp"
#include "proto/program/progress.hpp"

namespace shearbus::hydro {

void check_layer_start(const guest::HydroScene& scene, std::size_t interface_nodes) {
  constexpr const char* kKey = "hydro.layer_start";
  if (scene.hydro().layer_start() != guest::LAYER_START_SHOCKED) return;
  if (scene.hydro().has_shear_column())
    refuse(kKey, "layer_start shocked needs zones that a shock heats; shear_column has none",
           "give hydro.shear_column.initial_temperature_k, or leave layer_start out");
  if (scene.hydro().interface_law() != guest::INTERFACE_LAW_SUBGRID)
    refuse(kKey,
           fmt::format("layer_start shocked is for the layers of interface_law subgrid; this run has {}",
                       name(scene.hydro().interface_law())),
           "leave layer_start out: other laws take the zones' temperatures in every step");
  if (interface_nodes == 0)
    refuse(kKey, "layer_start shocked needs an interface; this problem has none", "leave layer_start out");
}

std::vector<double> layer_start(const guest::HydroScene& scene, const Problem2d& problem, bool progress) {
  const std::size_t nodes = interface_nodes(problem.bodies);
  std::vector<double> temperature(nodes, scene.scene().layer().initial_temperature_k());
  if (scene.hydro().layer_start() != guest::LAYER_START_SHOCKED) return temperature;
  std::vector<double> highest_pressure(nodes, 0.0);
  lagrange::Cycle cycle(problem.bodies);
  program::Progress bar("without friction", progress);
  while (cycle.state().time < problem.end_time && !(problem.over && problem.over(cycle))) {
    cycle.advance(problem.end_time);
    const InterfaceInputs& in = cycle.contact().inputs();
    for (std::size_t i = 0; i < nodes; ++i) {
      if (in.pressure[i] <= highest_pressure[i]) continue;
      highest_pressure[i] = in.pressure[i];
      temperature[i] = in.zone_temperature[i];
    }
    bar.show([&](double elapsed_s) {
      return program::extent_of_time({.begun_s = 0.0,
                                      .now_s = cycle.state().time,
                                      .end_s = problem.end_time,
                                      .begun_step = 0,
                                      .step = cycle.steps()},
                                     elapsed_s);
    });
  }
  bar.clear();
  return temperature;
}

}  // namespace shearbus::hydro
