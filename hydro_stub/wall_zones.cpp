#include "hydro_stub/wall_zones.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "hydro_stub/problem.hpp"
#include "server/physics/material/strength.hpp"

namespace shearbus::hydro {

using lagrange::Vec2;

std::vector<double> half_wall_zones(const lagrange::Bodies& bodies) {
  const lagrange::Mesh& mesh = bodies.mesh;
  const std::vector<Vec2>& x = mesh.places();
  std::vector<double> half;
  for (const lagrange::SlideLine& line : bodies.slide_lines) {
    if (!line.rubs) continue;
    const lagrange::Surface& soft = line.soft;
    std::vector<double> thickness;  // of the zone at each segment
    for (std::size_t s = 0; s < soft.zones.size(); ++s) {
      const int* n = mesh.zone_nodes(soft.zones[s]);
      const double area = 0.5 * cross(x[n[2]] - x[n[0]], x[n[3]] - x[n[1]]);
      thickness.push_back(area / norm(x[soft.nodes[s + 1]] - x[soft.nodes[s]]));
    }
    for (std::size_t i = 0; i < soft.count(); ++i) {
      const double before = thickness[i > 0 ? i - 1 : soft.closed() ? thickness.size() - 1 : 0];
      const double after = thickness[std::min(i, thickness.size() - 1)];
      // Nodes whose zones differ by rounding only get the same number, so that the server keeps them together.
      constexpr double kGrain = 1e-12;  // [m]
      half.push_back(kGrain * std::round(0.25 * (before + after) / kGrain));
    }
  }
  return half;
}

std::vector<double> plastic_layers(const SceneFile& file, std::vector<double> half_zone) {
  const v1::Scene& scene = file.scene.scene();
  if (file.scene.hydro().interface_law() != guest::INTERFACE_LAW_SUBGRID || !scene.interface().plastic_layer() ||
      half_zone.empty())
    return {};
  constexpr const char* kKey = "layer.thickness_m";
  if (file.document.places.contains(kKey)) {
    const double given = scene.layer().thickness_m();
    const auto [thinnest, thickest] = std::ranges::minmax(half_zone);
    constexpr double kTolerance = 0.01;
    if (given < (1.0 - kTolerance) * thinnest || given > (1.0 + kTolerance) * thickest)
      refuse(kKey,
             fmt::format("layer.thickness_m = {} m, but half the wall zones is {:.6g} to {:.6g} m: a plastic layer is "
                         "the metal that moves with the interface node",
                         given, thinnest, thickest),
             "leave layer.thickness_m out: shearbus-hydro sets it from its zones");
  }
  return half_zone;
}

InterfaceStrength interface_strength(const guest::HydroScene& scene, const physics::Material& soft) {
  const double temperature = scene.scene().layer().initial_temperature_k();
  InterfaceStrength strength{.metal = physics::adiabatic_peak(soft, 0.0, temperature),
                             .start_temperature = temperature};
  if (scene.hydro().interface_law() == guest::INTERFACE_LAW_SUBGRID) {
    strength.cold = scene.scene().interface().yield_strength_pa();
    strength.flows_in_layer = scene.scene().interface().plastic_layer();
  }
  return strength;
}

std::string melting_zone_warning(const guest::HydroScene& scene, double half_zone, double time) {
  const guest::Hydro& hydro = scene.hydro();
  const bool cone = hydro.has_cone_target();
  const bool graded = cone ? hydro.cone_target().has_first_zone_m() : hydro.sliding_plates().has_first_zone_m();
  const bool deep = hydro.coulomb_tresca().heat_depth() == guest::HEAT_DEPTH_DIFFUSION;
  return fmt::format(
      "hydro.{}.{}: with law (5) a zone at the interface, {:.4g} um thick, is at {} T_melt after {:.4g} us. The heat "
      "of friction stays {}: thicker zones heat less; raise {}{}, or use the subgrid law, which conducts",
      cone ? "cone_target" : "sliding_plates", graded ? "first_zone_m" : "zone_width_m", 2e6 * half_zone,
      physics::kMeltingShare, 1e6 * time, deep ? "near the interface" : "in it",
      graded ? "first_zone_m" : "zone_width_m", deep ? "" : " or set hydro.coulomb_tresca.heat_depth = \"diffusion\"");
}

}  // namespace shearbus::hydro
