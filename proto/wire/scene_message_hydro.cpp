#include "proto/wire/scene_message_hydro.hpp"

namespace shearbus::wire {
namespace {

void eos_to_message(const MieGrueneisen& eos, v1::MieGrueneisen& message) {
  if (eos.sound_speed_m_per_s) message.set_sound_speed_m_per_s(*eos.sound_speed_m_per_s);
  if (eos.hugoniot_slope) message.set_hugoniot_slope(*eos.hugoniot_slope);
  if (eos.grueneisen_coefficient) message.set_grueneisen_coefficient(*eos.grueneisen_coefficient);
  if (eos.tension_limit_pa) message.set_tension_limit_pa(*eos.tension_limit_pa);
}

MieGrueneisen eos_from_message(const v1::MieGrueneisen& message) {
  MieGrueneisen eos;
  if (message.has_sound_speed_m_per_s()) eos.sound_speed_m_per_s = message.sound_speed_m_per_s();
  if (message.has_hugoniot_slope()) eos.hugoniot_slope = message.hugoniot_slope();
  if (message.has_grueneisen_coefficient()) eos.grueneisen_coefficient = message.grueneisen_coefficient();
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

void verification_to_message(const Hydro& hydro, v1::Hydro& message) {
  if (hydro.piston) {
    v1::Piston& to = *message.mutable_piston();
    to.set_symmetry(static_cast<v1::Symmetry>(hydro.piston->symmetry));
    to.set_length_m(hydro.piston->length_m);
    to.set_zones(hydro.piston->zones);
    to.set_speed_m_per_s(hydro.piston->speed_m_per_s);
  }
  if (hydro.flyer_impact) {
    v1::FlyerImpact& to = *message.mutable_flyer_impact();
    to.set_symmetry(static_cast<v1::Symmetry>(hydro.flyer_impact->symmetry));
    to.set_length_m(hydro.flyer_impact->length_m);
    to.set_zones(hydro.flyer_impact->zones);
    to.set_speed_m_per_s(hydro.flyer_impact->speed_m_per_s);
  }
  if (hydro.implosion) {
    v1::Implosion& to = *message.mutable_implosion();
    to.set_shell(static_cast<v1::Shell>(hydro.implosion->shell));
    to.set_symmetry(static_cast<v1::Symmetry>(hydro.implosion->symmetry));
    to.set_inner_radius_m(hydro.implosion->inner_radius_m);
    to.set_outer_radius_m(hydro.implosion->outer_radius_m);
    to.set_stop_radius_m(hydro.implosion->stop_radius_m);
    to.set_zones(hydro.implosion->zones);
  }
  if (hydro.gas_flow) {
    v1::GasFlow& to = *message.mutable_gas_flow();
    to.set_test(static_cast<v1::GasTest>(hydro.gas_flow->test));
    to.set_symmetry(static_cast<v1::Symmetry>(hydro.gas_flow->symmetry));
    to.set_zones(hydro.gas_flow->zones);
  }
  if (hydro.taylor_bar) {
    v1::TaylorBar& to = *message.mutable_taylor_bar();
    to.set_radius_m(hydro.taylor_bar->radius_m);
    to.set_length_m(hydro.taylor_bar->length_m);
    to.set_speed_m_per_s(hydro.taylor_bar->speed_m_per_s);
    to.set_zones(hydro.taylor_bar->zones);
  }
  if (hydro.sliding_plates) {
    v1::SlidingPlates& to = *message.mutable_sliding_plates();
    to.set_length_m(hydro.sliding_plates->length_m);
    to.set_soft_depth_m(hydro.sliding_plates->soft_depth_m);
    to.set_hard_depth_m(hydro.sliding_plates->hard_depth_m);
    to.set_zone_width_m(hydro.sliding_plates->zone_width_m);
    to.set_velocity_jump_m_per_s(hydro.sliding_plates->velocity_jump_m_per_s);
    to.set_angle_deg(hydro.sliding_plates->angle_deg);
    to.set_pressure_pa(hydro.sliding_plates->pressure_pa);
  }
}

void verification_from_message(const v1::Hydro& message, Hydro& hydro) {
  if (message.has_piston()) {
    const v1::Piston& from = message.piston();
    Piston& to = hydro.piston.emplace();
    to.symmetry = enum_or(from.symmetry(), to.symmetry);
    to.length_m = from.length_m();
    to.zones = from.zones();
    to.speed_m_per_s = from.speed_m_per_s();
  }
  if (message.has_flyer_impact()) {
    const v1::FlyerImpact& from = message.flyer_impact();
    FlyerImpact& to = hydro.flyer_impact.emplace();
    to.symmetry = enum_or(from.symmetry(), to.symmetry);
    to.length_m = from.length_m();
    to.zones = from.zones();
    to.speed_m_per_s = from.speed_m_per_s();
  }
  if (message.has_implosion()) {
    const v1::Implosion& from = message.implosion();
    Implosion& to = hydro.implosion.emplace();
    to.shell = enum_or(from.shell(), to.shell);
    to.symmetry = enum_or(from.symmetry(), to.symmetry);
    to.inner_radius_m = from.inner_radius_m();
    to.outer_radius_m = from.outer_radius_m();
    to.stop_radius_m = from.stop_radius_m();
    to.zones = from.zones();
  }
  if (message.has_gas_flow()) {
    const v1::GasFlow& from = message.gas_flow();
    GasFlow& to = hydro.gas_flow.emplace();
    to.test = enum_or(from.test(), to.test);
    to.symmetry = enum_or(from.symmetry(), to.symmetry);
    to.zones = from.zones();
  }
  if (message.has_taylor_bar()) {
    const v1::TaylorBar& from = message.taylor_bar();
    TaylorBar& to = hydro.taylor_bar.emplace();
    to.radius_m = from.radius_m();
    to.length_m = from.length_m();
    to.speed_m_per_s = from.speed_m_per_s();
    to.zones = from.zones();
  }
  if (message.has_sliding_plates()) {
    const v1::SlidingPlates& from = message.sliding_plates();
    SlidingPlates& to = hydro.sliding_plates.emplace();
    to.length_m = from.length_m();
    to.soft_depth_m = from.soft_depth_m();
    to.hard_depth_m = from.hard_depth_m();
    to.zone_width_m = from.zone_width_m();
    to.velocity_jump_m_per_s = from.velocity_jump_m_per_s();
    to.angle_deg = from.angle_deg();
    to.pressure_pa = from.pressure_pa();
  }
}

}  // namespace

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
  verification_to_message(hydro, message);
  if (hydro.constant_shear_stress_pa) message.set_constant_shear_stress_pa(*hydro.constant_shear_stress_pa);
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
  verification_from_message(message, hydro);
  if (message.has_constant_shear_stress_pa()) hydro.constant_shear_stress_pa = message.constant_shear_stress_pa();
  return hydro;
}

}  // namespace shearbus::wire
