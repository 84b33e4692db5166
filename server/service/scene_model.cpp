#include "server/service/scene_model.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "proto/wire/limits.hpp"
#include "proto/wire/scene_file.hpp"
#include "proto/wire/status.hpp"
#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::service {
namespace {

bool is_steinberg_cochran_guinan(const physics::Material& m) {
  return m.flow_law == physics::FlowLaws::place<physics::SteinbergCochranGuinan>();
}

physics::Material material_of(const wire::Body& body, const std::string& table) {
  physics::MaterialResult made =
      physics::make_material(body.material, body.given, physics::FlowLaws::numbered(static_cast<int>(body.flow_law)));
  if (!made.fault.empty())
    throw wire::Error({.code = wire::Code::kInvalidScene,
                       .text = fmt::format("{}.{}: {}", table, made.fault_field, made.fault),
                       .remedy = "Name a material of the catalog, or give every constant.",
                       .field = table + "." + made.fault_field});
  if (body.melting_curve == wire::MeltingCurve::kLindemann)
    made.material.melting_curve = physics::MeltingCurve::kLindemann;
  if (body.pressure_term == wire::PressureTerm::kCompressed)
    made.material.pressure_term = physics::PressureTerm::kCompressed;
  if (body.pressure_term == wire::PressureTerm::kCompressed && !is_steinberg_cochran_guinan(made.material))
    throw wire::Error({.code = wire::Code::kInvalidScene,
                       .text = fmt::format("{}.pressure_term = \"compressed\" changes a pressure term that flow_law = "
                                           "\"{}\" does not have",
                                           table, physics::FlowLaws::name_of(made.material.flow_law)),
                       .remedy = "Leave it out, or take flow_law = \"steinberg_cochran_guinan\".",
                       .field = table + ".pressure_term"});
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

// What [hard_layer] leaves open is as in [layer] (beside a tolerance, its cells too), its thickness scaled to the depth
// heat reaches in the hard body.
wire::HardLayer filled(wire::HardLayer hard, const wire::Scene& scene, const physics::ModelOptions& options) {
  if (!hard.thickness_m)
    hard.thickness_m = scene.layer.thickness_m * std::sqrt(options.hard.diffusivity / options.soft.diffusivity);
  if (!hard.cells && !scene.tolerance) hard.cells = scene.layer.cells;
  if (!hard.grading && !scene.tolerance) hard.grading = scene.layer.grading;
  if (hard.far_boundary == wire::FarBoundary::kUnspecified) hard.far_boundary = scene.layer.far_boundary;
  return hard;
}

// Junctions are of the soft metal unless [junctions] says otherwise; fresh, they yield as the interface does.
wire::Junctions filled(wire::Junctions junctions, const physics::Material& soft) {
  if (!is_steinberg_cochran_guinan(soft) && !(junctions.hardening_coefficient && junctions.hardening_exponent))
    throw wire::Error({.code = wire::Code::kInvalidScene,
                       .text = fmt::format("[junctions] needs hardening_coefficient and hardening_exponent of its own: "
                                           "the soft body's flow law {} has none",
                                           physics::FlowLaws::name_of(soft.flow_law)),
                       .field = "junctions.hardening_coefficient"});
  if (!junctions.yield_strength_max_pa && std::isfinite(soft.yield_strength_max))
    junctions.yield_strength_max_pa = soft.yield_strength_max;
  if (!junctions.hardening_coefficient) junctions.hardening_coefficient = soft.hardening_coefficient;
  if (!junctions.hardening_exponent) junctions.hardening_exponent = soft.hardening_exponent;
  return junctions;
}

physics::JunctionOptions junctions_of(const wire::Junctions& junctions, const physics::ModelOptions& options) {
  physics::Material metal = options.soft;
  metal.flow_law = physics::FlowLaws::place<physics::SteinbergCochranGuinan>();  // DLP (52-53)
  metal.yield_strength = options.interface.yield_strength;
  metal.yield_strength_max = junctions.yield_strength_max_pa.value_or(std::numeric_limits<double>::infinity());
  metal.hardening_coefficient = *junctions.hardening_coefficient;
  metal.hardening_exponent = *junctions.hardening_exponent;
  return {.contact_fraction = junctions.contact_fraction, .height = junctions.height_m, .metal = metal};
}

physics::GridOptions hard_grid_of(const wire::HardLayer& hard) {
  return {.thickness = *hard.thickness_m,
          .cells = static_cast<int>(hard.cells.value_or(1)),
          .grading = hard.grading.value_or(1.0),
          .far_boundary = far_boundary_of(hard.far_boundary)};
}

physics::Drive drive_of(wire::Drive drive) {
  return drive == wire::Drive::kInterfaceSlip ? physics::Drive::kInterfaceSlip : physics::Drive::kLayerShear;
}

physics::InterfaceOptions interface_of(const wire::Interface& law) {
  return {.friction_coefficient = law.friction_coefficient,
          .yield_strength = law.yield_strength_pa,
          .friction_law =
              physics::FrictionLaws::numbered(static_cast<int>(law.friction_law)).value_or(physics::FrictionLaw{}),
          .friction_coefficient_fast = law.friction_coefficient_fast,
          .velocity_decay = law.velocity_decay_s_per_m};
}
static_assert(wire::kMaxInertiaCells == physics::kMaxInertiaCells);
// A half-space adds at most 49 vertices to its body's cells: each is 1.3 times the last, to 1000 thicknesses.
static_assert(wire::kMaxSleepCells + 2 * 50 <= physics::kMaxBasisVertices);

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
  made.options.inertia = scene.layer.inertia;
  if (scene.layer.inertia && !is_steinberg_cochran_guinan(made.options.soft))
    throw wire::Error({.code = wire::Code::kInvalidScene,
                       .text = fmt::format("layer.inertia works with flow law {}, the soft body has {}: its waves' "
                                           "return to the yield stress is that law's",
                                           physics::SteinbergCochranGuinan::kName,
                                           physics::FlowLaws::name_of(made.options.soft.flow_law)),
                       .remedy = "leave out layer.inertia, or choose another soft body",
                       .field = "layer.inertia"});
  made.options.tangential_components = static_cast<int>(scene.tangential_components);
  made.options.sleep = scene.layer.sleep;
  if (scene.layer.time_integrator == wire::TimeIntegrator::kSdirk2) {
    made.options.time_integrator = physics::TimeIntegrator::kSdirk2;
    if (!is_steinberg_cochran_guinan(made.options.soft))
      throw wire::Error({.code = wire::Code::kInvalidScene,
                         .text = fmt::format("layer.time_integrator = \"sdirk2\" works with flow law {}, the soft body "
                                             "has {}: its stress follows the rate of a step, to first order",
                                             physics::SteinbergCochranGuinan::kName,
                                             physics::FlowLaws::name_of(made.options.soft.flow_law)),
                         .remedy = "leave out layer.time_integrator, or choose another soft body",
                         .field = "layer.time_integrator"});
  }
  if (scene.layer.heat == wire::Heat::kModes) {
    const wire::HeatModes modes = scene.layer.modes.value_or(wire::HeatModes{});
    made.options.modes = physics::ModesOptions{
        .accuracy = modes.accuracy, .shortest_step = modes.shortest_step_s, .longest_time = modes.longest_time_s};
  }
  made.options.initial_temperature = scene.layer.initial_temperature_k;
  made.options.drive = drive_of(scene.velocity_driven.drive);
  made.options.friction_coefficient = scene.velocity_driven.friction_coefficient;
  made.options.taylor_quinney_factor = scene.velocity_driven.taylor_quinney_factor;
  if (scene.interface) made.options.interface = interface_of(*scene.interface);
  made.options.plastic_layer = scene.interface && scene.interface->plastic_layer;

  made.effective = scene;
  if (scene.layer.heat == wire::Heat::kModes && !scene.layer.modes) made.effective.layer.modes.emplace();
  if (scene.hard_layer) {
    made.effective.hard_layer = filled(*scene.hard_layer, scene, made.options);
    made.options.hard_grid = hard_grid_of(*made.effective.hard_layer);
  }
  if (scene.junctions) {
    made.effective.junctions = filled(*scene.junctions, made.options.soft);
    made.options.junctions = junctions_of(*made.effective.junctions, made.options);
  }
  if (scene.tolerance) made.options = physics::discretised(made.options, *scene.tolerance);
  made.effective.hydro.reset();
  made.effective.soft.given = physics::constants_of(made.options.soft);
  made.effective.hard.given = physics::constants_of(made.options.hard);
  return made;
}

}  // namespace shearbus::service
