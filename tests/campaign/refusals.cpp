#include "tests/campaign/refusals.hpp"

#include <algorithm>
#include <functional>
#include <limits>

#include "tests/support/service_harness.hpp"

namespace shearbus::study::stability {
namespace {

using support::ServiceHarness;
using v1::Scene;
using wire::Field;

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
  Scene scene;
};

Scene with(Scene scene, const std::function<void(Scene&)>& change) {
  change(scene);
  return scene;
}

std::vector<BadScene> bad_scenes() {
  const Scene velocity = support::velocity_scene(), force = support::force_scene();
  const auto soft = [&](const char* constant, double value) {
    return with(velocity, [&](Scene& s) { scene::set_numbers({{constant, value}}, *s.mutable_soft()); });
  };
  const auto starting_at = [&](double T) {
    return with(velocity, [&](Scene& s) { s.mutable_layer()->set_initial_temperature_k(T); });
  };
  return {
      {"T_ref at melting", "layer.initial_temperature_k", starting_at(1220.0)},
      {"T_ref above melting", "layer.initial_temperature_k", starting_at(5000.0)},
      {"T_ref 0 K", "layer.initial_temperature_k", starting_at(0.0)},
      {"T_ref not a number", "layer.initial_temperature_k", starting_at(kNaN)},
      {"n = 0", "soft.hardening_exponent", soft("hardening_exponent", 0.0)},
      {"beta < 0", "soft.hardening_coefficient", soft("hardening_coefficient", -1.0)},
      {"Y0 = 0", "soft.yield_strength_pa", soft("yield_strength_pa", 0.0)},
      {"k < 0", "soft.thermal_conductivity_w_per_m_k", soft("thermal_conductivity_w_per_m_k", -117.0)},
      {"alpha = 0", "soft.thermal_diffusivity_m2_per_s", soft("thermal_diffusivity_m2_per_s", 0.0)},
      {"T_melt infinite", "soft.melting_temperature_k", soft("melting_temperature_k", kInfinity)},
      {"h = 0", "layer.thickness_m", with(velocity, [](Scene& s) { s.mutable_layer()->set_thickness_m(0.0); })},
      {"no cells", "layer.cells", with(velocity, [](Scene& s) { s.mutable_layer()->set_cells(0); })},
      {"cells beyond any memory", "layer.cells",
       with(velocity, [](Scene& s) { s.mutable_layer()->set_cells(4000000000U); })},
      {"cells finer towards the far end", "layer.grading",
       with(velocity, [](Scene& s) { s.mutable_layer()->set_grading(0.5); })},
      {"mu < 0", "interface.friction_coefficient",
       with(force, [](Scene& s) { s.mutable_interface()->set_friction_coefficient(-0.3); })},
      {"interface without yield strength", "interface.yield_strength_pa",
       with(force, [](Scene& s) { s.mutable_interface()->set_yield_strength_pa(0.0); })},
      {"force-driven without an interface law", "strategy", with(force, [](Scene& s) { s.clear_interface(); })},
      {"inertia of a rigid layer", "layer.inertia",
       with(force, [](Scene& s) { s.mutable_layer()->set_inertia(true); })},
      {"inertia with a slip at z = 0", "layer.inertia",
       with(velocity,
            [](Scene& s) {
              s.mutable_layer()->set_inertia(true);
              s.mutable_velocity_driven()->set_drive(v1::DRIVE_INTERFACE_SLIP);
            })},
      {"plastic heating on a fixed share", "velocity_driven.taylor_quinney_factor",
       with(velocity, [](Scene& s) { s.mutable_velocity_driven()->set_taylor_quinney_factor(0.9); })},
      {"plastic heating of a rigid layer", "interface.taylor_quinney_factor",
       with(force,
            [](Scene& s) {
              s.mutable_hard_layer();
              s.mutable_interface()->set_taylor_quinney_factor(0.9);
            })},
      {"junctions that touch everywhere twice", "junctions.contact_fraction",
       with(force,
            [](Scene& s) {
              s.clear_junctions();
              s.mutable_junctions()->set_contact_fraction(2.0);
              s.mutable_junctions()->set_height_m(1e-7);
            })},
      {"two components of a shear rate", "tangential_components",
       with(velocity,
            [](Scene& s) {
              s.set_tangential_components(2);
              s.mutable_velocity_driven()->set_drive(v1::DRIVE_INTERFACE_SLIP);
            })},
      {"melting curve of the hard body", "hard.melting_curve",
       with(velocity, [](Scene& s) { s.mutable_hard()->set_melting_curve(v1::MELTING_CURVE_LINDEMANN); })},
      {"Simon's curve without its constants", "soft.simon_temperature_k",
       with(velocity, [](Scene& s) { s.mutable_soft()->set_melting_curve(v1::MELTING_CURVE_SIMON); })},
      {"pressure term of a law without one", "soft.pressure_term",
       with(velocity,
            [](Scene& s) {
              s.mutable_soft()->set_material("copper_ofhc_jc");
              s.mutable_soft()->set_pressure_term(v1::PRESSURE_TERM_COMPRESSED);
            })},
  };
}

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
  for (const BadScene& bad : bad_scenes()) {
    ServiceHarness host;
    refusals.push_back(told(bad.name, bad.field, host.ask(ServiceHarness::opening(bad.scene, support::node_ids(2)))));
  }
  const auto nodes = support::node_ids(4);
  const auto opened = [&](ServiceHarness& host) { host.ask(ServiceHarness::opening(support::force_scene(), nodes)); };
  for (const BadStep& bad : kBadSteps) {
    ServiceHarness host;
    opened(host);
    wire::Batch batch = support::step_columns(wire::Strategy::kForceDriven, nodes, 1);
    batch.f64(bad.field)[2] = bad.value;
    refusals.push_back(told(bad.name, wire::name(bad.field), host.ask(ServiceHarness::step(1, std::move(batch)))));
  }
  for (const auto& [name, dt] : kBadStepLengths) {
    ServiceHarness host;
    opened(host);
    wire::Request request = ServiceHarness::in_session(wire::Downscale{.dt_s = dt}, 1);
    request.batch = support::step_columns(wire::Strategy::kForceDriven, nodes, 1);
    refusals.push_back(told(name, "dt_s", host.ask(request)));
  }
  return refusals;
}

}  // namespace shearbus::study::stability
