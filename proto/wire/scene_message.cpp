#include "proto/wire/scene_message.hpp"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>

#include <string_view>

#include "proto/wire/scene_message_hydro.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"
#include "proto/wire/with_message.hpp"
#include "shearbus/v1/scene.pb.h"

namespace shearbus::wire {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

// The message with every absent scalar that has a default set to it, in the tables that are present.
void fill_table(Message& message) {
  const auto& reflection = *message.GetReflection();
  for (int i = 0; i < message.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor* field = message.GetDescriptor()->field(i);
    if (field->is_repeated()) continue;
    const bool present = reflection.HasField(message, field);
    if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      if (present) fill_table(*reflection.MutableMessage(&message, field));
      continue;
    }
    const v1::Rule& rule = field->options().GetExtension(v1::rule);
    if (present) continue;
    if (rule.has_default_number() && field->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE)
      reflection.SetDouble(&message, field, rule.default_number());
    else if (rule.has_default_number() && field->cpp_type() == FieldDescriptor::CPPTYPE_UINT32)
      reflection.SetUInt32(&message, field, static_cast<std::uint32_t>(rule.default_number()));
  }
}

[[noreturn]] void refuse(std::string field, std::string_view what) {
  std::string text = fmt::format("{} {}", field, what);
  throw Error({.code = Code::kInvalidScene, .text = std::move(text), .field = std::move(field)});
}

const std::string& checked(const std::string& text, const char* field) {
  if (!is_utf8(text)) refuse(field, "is not UTF-8 text");
  return text;
}

void body_to_message(const Body& body, const std::string& table, v1::Body& message) {
  message.set_material(checked(body.material, (table + ".material").c_str()));
  const auto& reflection = *message.GetReflection();
  for (const auto& [name, value] : body.given) {
    const FieldDescriptor* field = message.GetDescriptor()->FindFieldByName(name);
    const std::string path = fmt::format("{}.{}", table, as_utf8(name, 64));
    if (!field || field->cpp_type() != FieldDescriptor::CPPTYPE_DOUBLE) refuse(path, "is not a constant of a material");
    if (reflection.HasField(message, field)) refuse(path, "is given twice");
    reflection.SetDouble(&message, field, value);
  }
  // Defaults are not sent: a scene without these options has the bytes it had before there were any.
  if (body.melting_curve != MeltingCurve::kConstant)
    message.set_melting_curve(static_cast<v1::MeltingCurve>(body.melting_curve));
  if (body.pressure_term != PressureTerm::kLinear)
    message.set_pressure_term(static_cast<v1::PressureTerm>(body.pressure_term));
  message.set_flow_law(static_cast<v1::FlowLaw>(body.flow_law));
}

Body body_from_message(const v1::Body& message) {
  Body body{.material = message.material(), .given = {}};
  body.melting_curve = enum_or(message.melting_curve(), body.melting_curve);
  body.pressure_term = enum_or(message.pressure_term(), body.pressure_term);
  body.flow_law = static_cast<FlowLaw>(message.flow_law());
  for (int i = 0; i < message.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor* field = message.GetDescriptor()->field(i);
    if (field->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE && message.GetReflection()->HasField(message, field))
      body.given.emplace_back(field->name(), message.GetReflection()->GetDouble(message, field));
  }
  return body;
}

void hard_layer_to_message(const HardLayer& layer, v1::HardLayer& message) {
  if (layer.thickness_m) message.set_thickness_m(*layer.thickness_m);
  if (layer.cells) message.set_cells(*layer.cells);
  if (layer.grading) message.set_grading(*layer.grading);
  message.set_far_boundary(static_cast<v1::FarBoundary>(layer.far_boundary));
}

HardLayer hard_layer_from_message(const v1::HardLayer& message) {
  HardLayer layer{.far_boundary = static_cast<FarBoundary>(message.far_boundary())};
  if (message.has_thickness_m()) layer.thickness_m = message.thickness_m();
  if (message.has_cells()) layer.cells = message.cells();
  if (message.has_grading()) layer.grading = message.grading();
  return layer;
}

void junctions_to_message(const Junctions& junctions, v1::Junctions& message) {
  message.set_contact_fraction(junctions.contact_fraction);
  message.set_height_m(junctions.height_m);
  if (junctions.yield_strength_max_pa) message.set_yield_strength_max_pa(*junctions.yield_strength_max_pa);
  if (junctions.hardening_coefficient) message.set_hardening_coefficient(*junctions.hardening_coefficient);
  if (junctions.hardening_exponent) message.set_hardening_exponent(*junctions.hardening_exponent);
}

Junctions junctions_from_message(const v1::Junctions& message) {
  Junctions junctions{.contact_fraction = message.contact_fraction(), .height_m = message.height_m()};
  if (message.has_yield_strength_max_pa()) junctions.yield_strength_max_pa = message.yield_strength_max_pa();
  if (message.has_hardening_coefficient()) junctions.hardening_coefficient = message.hardening_coefficient();
  if (message.has_hardening_exponent()) junctions.hardening_exponent = message.hardening_exponent();
  return junctions;
}

void interface_to_message(const Interface& law, v1::Interface& message) {
  message.set_friction_coefficient(law.friction_coefficient);
  message.set_yield_strength_pa(law.yield_strength_pa);
  if (law.plastic_layer) message.set_plastic_layer(true);
  if (law.friction_law == FrictionLaw::kConstant) return;  // the default is not sent
  message.set_friction_law(static_cast<v1::FrictionLaw>(law.friction_law));
  message.set_friction_coefficient_fast(law.friction_coefficient_fast);
  message.set_velocity_decay_s_per_m(law.velocity_decay_s_per_m);
}

Interface interface_from_message(const v1::Interface& message) {
  Interface law{.friction_coefficient = message.friction_coefficient(),
                .yield_strength_pa = message.yield_strength_pa(),
                .plastic_layer = message.plastic_layer()};
  law.friction_law = enum_or(message.friction_law(), law.friction_law);
  law.friction_coefficient_fast = message.friction_coefficient_fast();
  law.velocity_decay_s_per_m = message.velocity_decay_s_per_m();
  return law;
}

}  // namespace

void to_message(const Scene& scene, v1::Scene& message) {
  message.Clear();
  message.set_name(checked(scene.name, "name"));
  message.set_source(checked(scene.source, "source"));
  message.set_strategy(static_cast<v1::Strategy>(scene.strategy));
  if (scene.soft.given_at_all()) body_to_message(scene.soft, "soft", *message.mutable_soft());
  if (scene.hard.given_at_all()) body_to_message(scene.hard, "hard", *message.mutable_hard());
  v1::Layer& layer = *message.mutable_layer();
  layer.set_thickness_m(scene.layer.thickness_m);
  // Beside a tolerance they are the server's choice: the default is not sent.
  if (!scene.tolerance || scene.layer.cells != Layer{}.cells) layer.set_cells(scene.layer.cells);
  if (!scene.tolerance || scene.layer.grading != Layer{}.grading) layer.set_grading(scene.layer.grading);
  layer.set_far_boundary(static_cast<v1::FarBoundary>(scene.layer.far_boundary));
  layer.set_initial_temperature_k(scene.layer.initial_temperature_k);
  if (scene.layer.inertia) layer.set_inertia(true);
  if (scene.layer.sleep) layer.set_sleep(true);
  if (scene.layer.time_integrator != TimeIntegrator::kBackwardEuler)
    layer.set_time_integrator(static_cast<v1::TimeIntegrator>(scene.layer.time_integrator));
  if (scene.layer.heat != Heat::kProfile) layer.set_heat(static_cast<v1::Heat>(scene.layer.heat));
  if (scene.layer.modes) {
    layer.mutable_modes()->set_accuracy(scene.layer.modes->accuracy);
    layer.mutable_modes()->set_shortest_step_s(scene.layer.modes->shortest_step_s);
    layer.mutable_modes()->set_longest_time_s(scene.layer.modes->longest_time_s);
  }
  if (scene.hard_layer) hard_layer_to_message(*scene.hard_layer, *message.mutable_hard_layer());
  v1::VelocityDriven& driven = *message.mutable_velocity_driven();
  driven.set_drive(static_cast<v1::Drive>(scene.velocity_driven.drive));
  if (scene.velocity_driven.friction_coefficient)
    driven.set_friction_coefficient(*scene.velocity_driven.friction_coefficient);
  if (scene.velocity_driven.taylor_quinney_factor)
    driven.set_taylor_quinney_factor(*scene.velocity_driven.taylor_quinney_factor);
  if (scene.interface) interface_to_message(*scene.interface, *message.mutable_interface());
  if (scene.junctions) junctions_to_message(*scene.junctions, *message.mutable_junctions());
  if (scene.tangential_components != 1) message.set_tangential_components(scene.tangential_components);
  if (scene.tolerance) message.set_tolerance(*scene.tolerance);
  if (scene.hydro) hydro_to_message(*scene.hydro, *message.mutable_hydro());
}

void fill_defaults(v1::Scene& message) {
  message.mutable_layer();
  if (message.layer().heat() == v1::HEAT_MODES) message.mutable_layer()->mutable_modes();
  if (message.has_hydro()) message.mutable_hydro()->mutable_coulomb_tresca();
  fill_table(message);
}

namespace {

Scene from_filled(const v1::Scene& message) {
  Scene scene;
  scene.name = message.name();
  scene.source = message.source();
  scene.strategy = static_cast<Strategy>(message.strategy());
  scene.soft = body_from_message(message.soft());
  scene.hard = body_from_message(message.hard());
  scene.layer = {.thickness_m = message.layer().thickness_m(),
                 .cells = message.layer().cells(),
                 .grading = message.layer().grading(),
                 .far_boundary = enum_or(message.layer().far_boundary(), scene.layer.far_boundary),
                 .initial_temperature_k = message.layer().initial_temperature_k(),
                 .inertia = message.layer().inertia(),
                 .time_integrator = enum_or(message.layer().time_integrator(), scene.layer.time_integrator),
                 .heat = enum_or(message.layer().heat(), scene.layer.heat),
                 .modes = {},
                 .sleep = message.layer().sleep()};
  if (message.layer().has_modes())
    scene.layer.modes = HeatModes{.accuracy = message.layer().modes().accuracy(),
                                  .shortest_step_s = message.layer().modes().shortest_step_s(),
                                  .longest_time_s = message.layer().modes().longest_time_s()};
  if (message.has_hard_layer()) scene.hard_layer = hard_layer_from_message(message.hard_layer());
  scene.velocity_driven.drive = enum_or(message.velocity_driven().drive(), scene.velocity_driven.drive);
  if (message.velocity_driven().has_friction_coefficient())
    scene.velocity_driven.friction_coefficient = message.velocity_driven().friction_coefficient();
  if (message.velocity_driven().has_taylor_quinney_factor())
    scene.velocity_driven.taylor_quinney_factor = message.velocity_driven().taylor_quinney_factor();
  if (message.has_interface()) scene.interface = interface_from_message(message.interface());
  if (message.has_junctions()) scene.junctions = junctions_from_message(message.junctions());
  scene.tangential_components = message.tangential_components();
  if (message.has_tolerance()) scene.tolerance = message.tolerance();
  if (message.has_hydro()) scene.hydro = hydro_from_message(message.hydro());
  return scene;
}

}  // namespace

Scene from_message(const v1::Scene& given) {
  return with_message<v1::Scene>([&](v1::Scene& message) {
    message = given;
    fill_defaults(message);
    return from_filled(message);
  });
}

}  // namespace shearbus::wire
