// Invariants of a scene with [melt_film] (server/physics/MODEL.md, "Melt film"): phases and temperatures belong
// together, and the stress is the lesser of what the solid contact and the film carry.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "server/physics/solver/melting/melt_film.hpp"
#include "tests/support/invariants/answered.hpp"
#include "tests/support/invariants/broken.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {

// Softening of the solid contact, DLP (15) without the melting factor: it keeps its strength up to T_melt.
inline double solid_softening(const Material& soft, double pressure, double T) {
  return std::max(0.0, 1.0 + soft.pressure_coefficient * pressure -
                           soft.temperature_coefficient * (std::min(T, soft.melting_temperature) - 300.0));
}

// Requires that a vertex with solid is not above melting, and one with liquid not below.
inline void require_phase(double T, double liquid, double T_melt) {
  require(liquid >= 0.0 && liquid <= 1.0, "liquid fraction {:.17g}", liquid);
  require(liquid == 1.0 || T <= T_melt, "solid at {:.17g} K, melting {:.17g} K", T, T_melt);
  require(liquid == 0.0 || T >= T_melt, "liquid at {:.17g} K, melting {:.17g} K", T, T_melt);
}

// Requires the law of the film, s integral(dz/eta) <= [V]new, with equality where the contact carries more than s. The
// viscosity is that at the temperatures before the step. `contact`: lower bound of what the solid contact carries
// [Pa].
inline void require_film(const Rig& rig, const Answered& a, int lane, double contact, Figures& figures) {
  require_near(rig.outputs.film_thickness[lane], rig.film_thickness(lane), 1e-13 * rig.film_thickness(lane),
               "thickness of the film");
  if (a.pressure <= 0.0) return;
  const MeltFilmOptions& film = *rig.model.options().melt_film;
  const Material soft = at_pressure(rig.model.options().soft, a.pressure);
  const double T_melt = soft.melting_temperature;
  const double latent = latent_rise(film, soft), diffused = soft.diffusivity * a.dt;
  const auto interface = static_cast<std::size_t>(rig.heat_grid().interface);
  const std::vector<double> before = rig.temperatures(rig.trial, lane), after = rig.temperatures(rig.committed, lane);
  double compliance = 0.0, grain = 0.0;
  for (std::size_t i = 0; i < rig.model.layout().num_vertices; ++i) {
    const int vertex = static_cast<int>(i);
    const double T = std::max(T_melt, before[interface + i]);
    const double eta = film.viscosity * std::exp(film.activation_energy / 8.31446261815324 * (1.0 / T - 1.0 / T_melt));
    const double weight = rig.heat_grid().weight[interface + i];
    compliance += weight * rig.liquid(vertex, lane) / eta;
    // The last digits of a temperature melt or freeze some metal, the more the less latent heat it has and the more of
    // it is conducted in the step.
    const double conducts =
        diffused / (weight * rig.heat_grid().width[std::min(interface + i, rig.heat_grid().width.size() - 1)]);
    const double hottest = std::max(T, after[interface + i]);
    if (rig.liquid(vertex, lane) > 0.0) grain += weight / eta * kDigits * hottest / latent * (1.0 + conducts);
  }
  grain += kDigits * a.heat / (soft.density * film.latent_heat * film.viscosity);
  const double sheared = std::abs(a.stress) * compliance;
  const double noise = 1e-12 * (a.size() + sheared) + std::abs(a.stress) * grain + kProductOfDenormals +
                       std::numeric_limits<double>::denorm_min() * compliance;
  require(sheared <= std::abs(a.jump_new) + noise, "the film is sheared at {:.17g} m/s by a jump of {:.17g} m/s",
          sheared, a.jump_new);
  if (compliance > 0.0 && std::abs(a.stress) < contact)
    require_near(sheared, std::abs(a.jump_new), 1e-9 * std::abs(a.jump_new) + noise, "slip of the film");
  figures.films += compliance > 0.0;
}

}  // namespace shearbus::testing
