#include "tests/campaign/refusals.hpp"

#include <limits>

#include "tests/support/changed_scene.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::study::stability {
namespace {

using support::ServiceHarness;
using wire::Field;

constexpr wire::Strategy kVelocity = wire::Strategy::kVelocityDriven, kForce = wire::Strategy::kForceDriven;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

Refusal told(std::string name, std::string field, const support::Answer& answer) {
  Refusal refusal{std::move(name), std::move(field), {}, {}};
  if (answer.code() == wire::Code::kOk) return refusal;
  refusal.named = answer.reply.status.field;
  refusal.text = answer.reply.status.text;
  return refusal;
}

// ---- Scenes that a service must refuse ----

struct BadScene {
  const char* name;
  const char* field;
  wire::Strategy strategy;
  const char* changes;  // of a small scene of the strategy
};
constexpr BadScene kBadScenes[] = {
    {"T_ref at melting", "layer.initial_temperature_k", kVelocity, "layer { initial_temperature_k: 1220 }"},
    {"T_ref above melting", "layer.initial_temperature_k", kVelocity, "layer { initial_temperature_k: 5000 }"},
    {"T_ref 0 K", "layer.initial_temperature_k", kVelocity, "layer { initial_temperature_k: 0 }"},
    {"T_ref not a number", "layer.initial_temperature_k", kVelocity, "layer { initial_temperature_k: nan }"},
    {"n = 0", "soft.hardening_exponent", kVelocity, "soft { hardening_exponent: 0 }"},
    {"beta < 0", "soft.hardening_coefficient", kVelocity, "soft { hardening_coefficient: -1 }"},
    {"Y0 = 0", "soft.yield_strength_pa", kVelocity, "soft { yield_strength_pa: 0 }"},
    {"k < 0", "soft.thermal_conductivity_w_per_m_k", kVelocity, "soft { thermal_conductivity_w_per_m_k: -117 }"},
    {"alpha = 0", "soft.thermal_diffusivity_m2_per_s", kVelocity, "soft { thermal_diffusivity_m2_per_s: 0 }"},
    {"T_melt infinite", "soft.melting_temperature_k", kVelocity, "soft { melting_temperature_k: inf }"},
    {"h = 0", "layer.thickness_m", kVelocity, "layer { thickness_m: 0 }"},
    {"no cells", "layer.cells", kVelocity, "layer { cells: 0 }"},
    {"cells beyond any memory", "layer.cells", kVelocity, "layer { cells: 4000000000 }"},
    {"cells finer towards the far end", "layer.grading", kVelocity, "layer { grading: 0.5 }"},
    {"mu < 0", "interface.friction_coefficient", kForce, "interface { friction_coefficient: -0.3 }"},
    {"interface without yield strength", "interface.yield_strength_pa", kForce, "interface { yield_strength_pa: 0 }"},
    {"force-driven without an interface law", "strategy", kVelocity, "strategy: STRATEGY_FORCE_DRIVEN"},
    {"inertia of a rigid layer", "layer.inertia", kForce, "layer { inertia: true }"},
    {"inertia with a slip at z = 0", "layer.inertia", kVelocity,
     "layer { inertia: true } velocity_driven { drive: DRIVE_INTERFACE_SLIP }"},
    {"plastic heating on a fixed share", "velocity_driven.taylor_quinney_factor", kVelocity,
     "velocity_driven { taylor_quinney_factor: 0.9 }"},
    {"plastic heating of a rigid layer", "interface.taylor_quinney_factor", kForce,
     "interface { taylor_quinney_factor: 0.9 } hard_layer {}"},
    {"junctions that touch everywhere twice", "junctions.contact_fraction", kForce,
     "junctions { contact_fraction: 2 height_m: 1e-7 }"},
    {"two components of a shear rate", "tangential_components", kVelocity,
     "tangential_components: 2 velocity_driven { drive: DRIVE_INTERFACE_SLIP }"},
    {"melting curve of the hard body", "hard.melting_curve", kVelocity,
     "hard { melting_curve: MELTING_CURVE_LINDEMANN }"},
    {"Simon's curve without its constants", "soft.simon_temperature_k", kVelocity,
     "soft { melting_curve: MELTING_CURVE_SIMON }"},
    {"pressure term of a law without one", "soft.pressure_term", kVelocity,
     "soft { material: 'copper_ofhc_jc' pressure_term: PRESSURE_TERM_COMPRESSED }"},
};

// ---- Steps that a service must refuse ----

struct BadStep {
  const char* name;
  Field field;
  double value;
};
constexpr BadStep kBadSteps[] = {
    {"P not a number", Field::kPressure, kNaN},
    {"P in units of its own", Field::kPressure, 11.2e12},
    {"[V] infinite", Field::kVelocityJump, kInfinity},
    {"[V] in mm/s", Field::kVelocityJump, 1e7},
    {"far stress of 1e13 Pa", Field::kStressSoft, -1e13},
    {"mass 0", Field::kMassSoft, 0.0},
    {"mass < 0", Field::kMassHard, -0.01},
    {"mass 1e-30 kg/m2", Field::kMassHard, 1e-30},
    {"mass 1e30 kg/m2", Field::kMassSoft, 1e30},
};
constexpr std::pair<const char*, double> kBadStepLengths[] = {
    {"dt 0", 0.0}, {"dt < 0", -1e-9}, {"dt not a number", kNaN}, {"dt infinite", kInfinity}, {"dt in ns", 10.0}};

}  // namespace

std::vector<Refusal> run_refusals() {
  std::vector<Refusal> refusals;
  for (const BadScene& bad : kBadScenes) {
    ServiceHarness host;
    const v1::Scene scene = support::with(support::scene_of(bad.strategy), bad.changes);
    refusals.push_back(told(bad.name, bad.field, host.ask(ServiceHarness::opening(scene, support::node_ids(2)))));
  }
  const auto nodes = support::node_ids(4);
  const auto opened = [&](ServiceHarness& host) { host.ask(ServiceHarness::opening(support::force_scene(), nodes)); };
  for (const BadStep& bad : kBadSteps) {
    ServiceHarness host;
    opened(host);
    wire::Batch batch = support::step_columns(kForce, nodes, 1);
    batch.f64(bad.field)[2] = bad.value;
    refusals.push_back(told(bad.name, wire::name(bad.field), host.ask(ServiceHarness::step(1, std::move(batch)))));
  }
  for (const auto& [name, dt] : kBadStepLengths) {
    ServiceHarness host;
    opened(host);
    wire::Request request = ServiceHarness::in_session(wire::Downscale{.dt_s = dt}, 1);
    request.batch = support::step_columns(kForce, nodes, 1);
    refusals.push_back(told(name, "dt_s", host.ask(request)));
  }
  return refusals;
}

}  // namespace shearbus::study::stability
