#include "server/service/scene_model.hpp"

#include <fmt/format.h>

#include <cmath>
#include <string>
#include <utility>

#include "proto/wire/scene_file.hpp"
#include "proto/wire/status.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::service {
namespace {

physics::Material material_of(const wire::Body& body, const std::string& table) {
  physics::MaterialResult made = physics::make_material(body.material, body.given);
  if (!made.fault.empty())
    throw wire::Error({.code = wire::Code::kInvalidScene,
                       .text = fmt::format("{}.{}: {}", table, made.fault_field, made.fault),
                       .remedy = "Name a material of the catalog, or give every constant.",
                       .field = table + "." + made.fault_field});
  if (body.melting_curve == wire::MeltingCurve::kLindemann)
    made.material.melting_curve = physics::MeltingCurve::kLindemann;
  if (body.pressure_term == wire::PressureTerm::kCompressed)
    made.material.pressure_term = physics::PressureTerm::kCompressed;
  if (const std::string_view missing = physics::constant_missing_for_options(made.material); !missing.empty())
    throw wire::Error({.code = wire::Code::kInvalidScene,
                       .text = fmt::format("{}.{} is missing: melting_curve = \"lindemann\" and pressure_term = "
                                           "\"compressed\" need the compression at a pressure",
                                           table, missing),
                       .remedy = "Give it, or leave both options at their defaults.",
                       .field = fmt::format("{}.{}", table, missing)});
  return made.material;
}

physics::FarBoundary far_boundary_of(wire::FarBoundary boundary) {
  return boundary == wire::FarBoundary::kHalfSpace ? physics::FarBoundary::kHalfSpace
                                                   : physics::FarBoundary::kInsulated;
}

// What [hard_layer] leaves open is as in [layer], its thickness scaled to the depth heat reaches in the hard body.
wire::HardLayer filled(wire::HardLayer hard, const wire::Scene& scene, const physics::ModelOptions& options) {
  if (!hard.thickness_m)
    hard.thickness_m = scene.layer.thickness_m * std::sqrt(options.hard.diffusivity / options.soft.diffusivity);
  if (!hard.cells) hard.cells = scene.layer.cells;
  if (!hard.grading) hard.grading = scene.layer.grading;
  if (hard.far_boundary == wire::FarBoundary::kUnspecified) hard.far_boundary = scene.layer.far_boundary;
  return hard;
}

physics::GridOptions hard_grid_of(const wire::HardLayer& hard) {
  return {.thickness = *hard.thickness_m,
          .cells = static_cast<int>(*hard.cells),
          .grading = *hard.grading,
          .far_boundary = far_boundary_of(hard.far_boundary)};
}

physics::Drive drive_of(wire::Drive drive) {
  return drive == wire::Drive::kInterfaceSlip ? physics::Drive::kInterfaceSlip : physics::Drive::kLayerShear;
}

}  // namespace

SceneModel scene_model(const wire::Scene& scene) {
  if (const wire::Status status = wire::check_scene(scene); !status.ok()) throw wire::Error(status);

  SceneModel made;
  made.options.soft = material_of(scene.soft, "soft");
  made.options.hard = material_of(scene.hard, "hard");
  made.options.strategy = scene.strategy == wire::Strategy::kForceDriven ? physics::Strategy::kForceDriven
                                                                         : physics::Strategy::kVelocityDriven;
  made.options.grid = {.thickness = scene.layer.thickness_m,
                       .cells = static_cast<int>(scene.layer.cells),
                       .grading = scene.layer.grading,
                       .far_boundary = far_boundary_of(scene.layer.far_boundary)};
  if (scene.layer.time_integrator == wire::TimeIntegrator::kSdirk2)
    made.options.time_integrator = physics::TimeIntegrator::kSdirk2;
  if (scene.layer.heat == wire::Heat::kModes) {
    const wire::HeatModes modes = scene.layer.modes.value_or(wire::HeatModes{});
    made.options.modes = physics::ModesOptions{
        .accuracy = modes.accuracy, .shortest_step = modes.shortest_step_s, .longest_time = modes.longest_time_s};
  }
  made.options.initial_temperature = scene.layer.initial_temperature_k;
  made.options.drive = drive_of(scene.velocity_driven.drive);
  made.options.friction_coefficient = scene.velocity_driven.friction_coefficient;
  made.options.taylor_quinney_factor = scene.velocity_driven.taylor_quinney_factor;
  if (scene.interface)
    made.options.interface = {.friction_coefficient = scene.interface->friction_coefficient,
                              .yield_strength = scene.interface->yield_strength_pa};
  made.options.plastic_layer = scene.interface && scene.interface->plastic_layer;

  made.effective = scene;
  if (scene.layer.heat == wire::Heat::kModes && !scene.layer.modes) made.effective.layer.modes.emplace();
  if (scene.hard_layer) {
    made.effective.hard_layer = filled(*scene.hard_layer, scene, made.options);
    made.options.hard_grid = hard_grid_of(*made.effective.hard_layer);
  }
  made.effective.hydro.reset();
  made.effective.soft.given = physics::constants_of(made.options.soft);
  made.effective.hard.given = physics::constants_of(made.options.hard);
  return made;
}

}  // namespace shearbus::service
