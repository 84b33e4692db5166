#include "proto/wire/scene_message.hpp"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>

#include <string_view>

#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"
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
}

// An enum of the message as a value; `fallback` is what its rule calls the default.
template <typename Enum, typename Wire>
Enum enum_or(Wire wire, Enum fallback) {
  return wire == Wire{} ? fallback : static_cast<Enum>(wire);
}

Body body_from_message(const v1::Body& message) {
  Body body{.material = message.material(), .given = {}};
  body.melting_curve = enum_or(message.melting_curve(), body.melting_curve);
  body.pressure_term = enum_or(message.pressure_term(), body.pressure_term);
  for (int i = 0; i < message.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor* field = message.GetDescriptor()->field(i);
    if (field->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE && message.GetReflection()->HasField(message, field))
      body.given.emplace_back(field->name(), message.GetReflection()->GetDouble(message, field));
  }
  return body;
}

void eos_to_message(const MieGrueneisen& eos, v1::MieGrueneisen& message) {
  message.set_sound_speed_m_per_s(eos.sound_speed_m_per_s);
  message.set_hugoniot_slope(eos.hugoniot_slope);
  message.set_grueneisen_coefficient(eos.grueneisen_coefficient);
  if (eos.tension_limit_pa) message.set_tension_limit_pa(*eos.tension_limit_pa);
}

MieGrueneisen eos_from_message(const v1::MieGrueneisen& message) {
  MieGrueneisen eos = {.sound_speed_m_per_s = message.sound_speed_m_per_s(),
                       .hugoniot_slope = message.hugoniot_slope(),
                       .grueneisen_coefficient = message.grueneisen_coefficient()};
  if (message.has_tension_limit_pa()) eos.tension_limit_pa = message.tension_limit_pa();
  return eos;
}

void cone_to_message(const ConeTarget& cone, v1::ConeTarget& message) {
  message.set_length_m(cone.length_m);
  message.set_front_radius_m(cone.front_radius_m);
  message.set_back_radius_m(cone.back_radius_m);
  message.set_confinement_radius_m(cone.confinement_radius_m);
  message.set_flyer_thickness_m(cone.flyer_thickness_m);
  message.set_flyer_speed_m_per_s(cone.flyer_speed_m_per_s);
  message.set_zone_width_m(cone.zone_width_m);
  message.set_courant(cone.courant);
  message.set_history_interval_s(cone.history_interval_s);
  message.set_frames(cone.frames);
  eos_to_message(cone.soft_eos, *message.mutable_soft_eos());
  eos_to_message(cone.hard_eos, *message.mutable_hard_eos());
}

ConeTarget cone_from_message(const v1::ConeTarget& message) {
  return {.length_m = message.length_m(),
          .front_radius_m = message.front_radius_m(),
          .back_radius_m = message.back_radius_m(),
          .confinement_radius_m = message.confinement_radius_m(),
          .flyer_thickness_m = message.flyer_thickness_m(),
          .flyer_speed_m_per_s = message.flyer_speed_m_per_s(),
          .zone_width_m = message.zone_width_m(),
          .courant = message.courant(),
          .history_interval_s = message.history_interval_s(),
          .frames = message.frames(),
          .soft_eos = eos_from_message(message.soft_eos()),
          .hard_eos = eos_from_message(message.hard_eos())};
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

void hydro_to_message(const Hydro& hydro, v1::Hydro& message) {
  message.set_interface_law(static_cast<v1::InterfaceLaw>(hydro.interface_law));
  message.set_end_time_s(hydro.end_time_s);
  if (hydro.dt_s) message.set_dt_s(*hydro.dt_s);
  message.set_cfl(hydro.cfl);
  if (hydro.shear_column) {
    const ShearColumn& column = *hydro.shear_column;
    v1::ShearColumn& to = *message.mutable_shear_column();
    to.set_length_m(column.length_m);
    to.set_zones(column.zones);
    to.set_far_end(static_cast<v1::FarEnd>(column.far_end));
    const auto copy = [](const std::vector<double>& from, auto* list) { list->Add(from.begin(), from.end()); };
    copy(column.velocity_jump_m_per_s, to.mutable_velocity_jump_m_per_s());
    copy(column.initial_temperature_k, to.mutable_initial_temperature_k());
    copy(column.pressure_pa, to.mutable_pressure_pa());
    copy(column.pressure_time_s, to.mutable_pressure_time_s());
    to.set_lists(static_cast<v1::Lists>(column.lists));
  }
  v1::CoulombTresca& law = *message.mutable_coulomb_tresca();
  law.set_friction_coefficient_at_rest(hydro.coulomb_tresca.friction_coefficient_at_rest);
  law.set_friction_coefficient_fast(hydro.coulomb_tresca.friction_coefficient_fast);
  law.set_velocity_decay_s_per_m(hydro.coulomb_tresca.velocity_decay_s_per_m);
  law.set_yield_fraction(hydro.coulomb_tresca.yield_fraction);
  if (hydro.cone_target) cone_to_message(*hydro.cone_target, *message.mutable_cone_target());
}

Hydro hydro_from_message(const v1::Hydro& message) {
  Hydro hydro;
  hydro.interface_law = enum_or(message.interface_law(), hydro.interface_law);
  hydro.end_time_s = message.end_time_s();
  if (message.has_dt_s()) hydro.dt_s = message.dt_s();
  hydro.cfl = message.cfl();
  if (message.has_shear_column()) {
    const v1::ShearColumn& from = message.shear_column();
    ShearColumn& column = hydro.shear_column.emplace();
    column.length_m = from.length_m();
    column.zones = from.zones();
    column.far_end = enum_or(from.far_end(), column.far_end);
    column.velocity_jump_m_per_s.assign(from.velocity_jump_m_per_s().begin(), from.velocity_jump_m_per_s().end());
    column.initial_temperature_k.assign(from.initial_temperature_k().begin(), from.initial_temperature_k().end());
    column.pressure_pa.assign(from.pressure_pa().begin(), from.pressure_pa().end());
    column.pressure_time_s.assign(from.pressure_time_s().begin(), from.pressure_time_s().end());
    column.lists = enum_or(from.lists(), column.lists);
  }
  hydro.coulomb_tresca = {.friction_coefficient_at_rest = message.coulomb_tresca().friction_coefficient_at_rest(),
                          .friction_coefficient_fast = message.coulomb_tresca().friction_coefficient_fast(),
                          .velocity_decay_s_per_m = message.coulomb_tresca().velocity_decay_s_per_m(),
                          .yield_fraction = message.coulomb_tresca().yield_fraction()};
  if (message.has_cone_target()) hydro.cone_target = cone_from_message(message.cone_target());
  return hydro;
}

}  // namespace

void to_message(const Scene& scene, v1::Scene& message) {
  message.Clear();
  message.set_name(checked(scene.name, "name"));
  message.set_source(checked(scene.source, "source"));
  message.set_strategy(static_cast<v1::Strategy>(scene.strategy));
  body_to_message(scene.soft, "soft", *message.mutable_soft());
  body_to_message(scene.hard, "hard", *message.mutable_hard());
  v1::Layer& layer = *message.mutable_layer();
  layer.set_thickness_m(scene.layer.thickness_m);
  layer.set_cells(scene.layer.cells);
  layer.set_grading(scene.layer.grading);
  layer.set_far_boundary(static_cast<v1::FarBoundary>(scene.layer.far_boundary));
  layer.set_initial_temperature_k(scene.layer.initial_temperature_k);
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
  if (scene.interface) {
    message.mutable_interface()->set_friction_coefficient(scene.interface->friction_coefficient);
    message.mutable_interface()->set_yield_strength_pa(scene.interface->yield_strength_pa);
    if (scene.interface->plastic_layer) message.mutable_interface()->set_plastic_layer(true);
  }
  if (scene.hydro) hydro_to_message(*scene.hydro, *message.mutable_hydro());
}

void fill_defaults(v1::Scene& message) {
  message.mutable_layer();
  if (message.layer().heat() == v1::HEAT_MODES) message.mutable_layer()->mutable_modes();
  if (message.has_hydro()) message.mutable_hydro()->mutable_coulomb_tresca();
  fill_table(message);
}

Scene from_message(const v1::Scene& given) {
  v1::Scene message = given;
  fill_defaults(message);

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
                 .time_integrator = enum_or(message.layer().time_integrator(), scene.layer.time_integrator),
                 .heat = enum_or(message.layer().heat(), scene.layer.heat),
                 .modes = {}};
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
  if (message.has_interface())
    scene.interface = Interface{.friction_coefficient = message.interface().friction_coefficient(),
                                .yield_strength_pa = message.interface().yield_strength_pa(),
                                .plastic_layer = message.interface().plastic_layer()};
  if (message.has_hydro()) scene.hydro = hydro_from_message(message.hydro());
  return scene;
}

}  // namespace shearbus::wire
