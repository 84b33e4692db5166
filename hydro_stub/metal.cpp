#include "hydro_stub/metal.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "hydro_stub/problem.hpp"

namespace shearbus::hydro {

Metal make_metal(const v1::Body& body, const std::string& table, const guest::MieGrueneisen& other) {
  const physics::Material material = resolve(body, table);
  const auto constant = [&](bool given, double there, double own, const char* key) {
    const double value = given ? there : own;
    if (std::isnan(value))
      refuse(table + "." + key, fmt::format("{}.{} is missing: the equation of state needs it", table, key),
             "give it, or a material of the catalog that has it");
    return value;
  };
  constexpr double kRoomTemperature = 300.0;
  Metal metal{.eos = {.density = material.density,
                      .sound_speed = constant(other.has_sound_speed_m_per_s(), other.sound_speed_m_per_s(),
                                              material.sound_speed, "sound_speed_m_per_s"),
                      .s1 = constant(other.has_hugoniot_slope(), other.hugoniot_slope(), material.hugoniot_slope,
                                     "hugoniot_slope"),
                      .gamma0 = constant(other.has_grueneisen_coefficient(), other.grueneisen_coefficient(),
                                         material.grueneisen, "grueneisen_coefficient"),
                      .specific_heat = material.specific_heat,
                      .reference_temperature = kRoomTemperature},
              .strength = material};
  if (other.has_tension_limit_pa()) metal.eos.tension_limit = other.tension_limit_pa();
  return metal;
}

void fill(lagrange::Bodies& bodies, const lagrange::Block& block, double density, double energy,
          lagrange::Vec2 velocity) {
  std::fill_n(bodies.density.begin() + block.first_zone, block.num_zones(), density);
  std::fill_n(bodies.energy.begin() + block.first_zone, block.num_zones(), energy);
  std::fill_n(bodies.velocity.begin() + block.first_node, block.num_nodes(), velocity);
}

}  // namespace shearbus::hydro
