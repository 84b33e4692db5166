#include "hydro_stub/cone_target.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "hydro_stub/grading.hpp"
#include "hydro_stub/problem.hpp"
#include "proto/wire/status.hpp"
#include "server/physics/material/strength.hpp"

namespace shearbus::hydro {

using lagrange::Side;
using lagrange::Vec2;

namespace {

double flank_radius(const guest::ConeTarget& cone, double z) {
  return cone.front_radius_m() + (cone.back_radius_m() - cone.front_radius_m()) * z / cone.length_m();
}

Grading grading_of(const guest::ConeTarget& cone) {
  return checked_grading("hydro.cone_target", cone.has_first_zone_m(), cone.first_zone_m(), cone.zone_growth(),
                         cone.zone_width_m(), cone.confinement_radius_m());
}

// Radial distances of nodes from the flank. Growing zones have the same thickness, normal to the flank, all along it;
// the zones beyond share what remains of the body at each height.
class FlankNodes {
 public:
  // `mean`, `thinnest`: mean and smallest radial thickness of the body  [m]
  FlankNodes(const guest::ConeTarget& cone, double mean, double thinnest)
      : nodes_(graded_nodes(mean, grading_of(cone))), mean_(mean) {
    const double slope = (cone.back_radius_m() - cone.front_radius_m()) / cone.length_m();
    along_radius_ = std::sqrt(1.0 + slope * slope);  // radial distance per distance normal to the flank
    constexpr double kMostOfThinnest = 0.75;
    while (nodes_.graded > 1 && along_radius_ * nodes_.distance[nodes_.graded] > kMostOfThinnest * thinnest)
      --nodes_.graded;
  }
  int zones() const { return static_cast<int>(nodes_.distance.size()) - 1; }
  // Radial distance of node k from the flank at a height where the body is `thick`.
  double at(int k, double thick) const {
    const std::size_t node = static_cast<std::size_t>(k);
    if (node <= nodes_.graded) return along_radius_ * nodes_.distance[node];
    const double begin = nodes_.distance[nodes_.graded];
    const double share = (nodes_.distance[node] - begin) / (mean_ - begin);
    return along_radius_ * begin + (thick - along_radius_ * begin) * share;
  }

 private:
  GradedNodes nodes_;
  double mean_;
  double along_radius_;
};

void add_graded_blocks(lagrange::Mesh& mesh, const guest::ConeTarget& cone, int along) {
  const double mean = 0.5 * (cone.front_radius_m() + cone.back_radius_m());
  const double outer = cone.confinement_radius_m();
  const FlankNodes inside(cone, mean, std::min(cone.front_radius_m(), cone.back_radius_m()));
  const FlankNodes outside(cone, outer - mean, outer - std::max(cone.front_radius_m(), cone.back_radius_m()));
  mesh.add_block(inside.zones(), along, [&](int i, int j) {
    const double z = cone.length_m() * j / along;
    const double flank = flank_radius(cone, z);
    return Vec2{i == 0 ? 0.0 : flank - inside.at(inside.zones() - i, flank), z};
  });
  mesh.add_block(outside.zones(), along, [&](int i, int j) {
    const double z = cone.length_m() * j / along;
    const double flank = flank_radius(cone, z);
    return Vec2{i == outside.zones() ? outer : flank + outside.at(i, outer - flank), z};
  });
}

}  // namespace

ConeTarget make_cone_target(const guest::HydroScene& scene) {
  ConeTarget problem{.scene = scene.hydro().cone_target(),
                     .end_time = scene.hydro().end_time_s(),
                     .soft = make_metal(scene.scene().soft(), "soft", scene.hydro().cone_target().soft_eos()),
                     .hard = make_metal(scene.scene().hard(), "hard", scene.hydro().cone_target().hard_eos())};
  const v1::Layer& layer = scene.scene().layer();
  // The bound assumes that the bodies keep their heat.
  const bool loses_heat = layer.far_boundary() == v1::FAR_BOUNDARY_ISOTHERMAL ||
                          scene.scene().hard_layer().far_boundary() == v1::FAR_BOUNDARY_ISOTHERMAL;
  if (scene.hydro().interface_law() == guest::INTERFACE_LAW_SUBGRID && !layer.inertia() && !loses_heat &&
      !scene.scene().has_melt_film() && physics::properties_of(problem.soft.strength.flow_law).vanishes_at_melting) {
    problem.heat_bound = {.soft = problem.soft.strength,
                          .hard = problem.hard.strength,
                          .start_temperature = layer.initial_temperature_k()};
  }
  const guest::ConeTarget& cone = problem.scene;
  const double widest = std::max(cone.front_radius_m(), cone.back_radius_m());
  if (!(widest < cone.confinement_radius_m())) {
    refuse("hydro.cone_target.confinement_radius_m",
           fmt::format("the confinement's radius {} m does not contain the cone's {} m", cone.confinement_radius_m(),
                       widest),
           "make the confinement wider or the cone narrower");
  }
  const double thinnest = std::min({cone.length_m(), cone.front_radius_m(), cone.back_radius_m(),
                                    cone.flyer_thickness_m(), cone.confinement_radius_m() - widest});
  if (!(cone.zone_width_m() <= 0.5 * thinnest)) {
    refuse("hydro.cone_target.zone_width_m",
           fmt::format("zones of {} m do not go twice into the thinnest part, {} m", cone.zone_width_m(), thinnest),
           "lower zone_width_m");
  }
  grading_of(cone);  // refuses what cannot be meshed
  constexpr double kMostZones = 5e6;
  double zones = cone.confinement_radius_m() * (cone.length_m() + cone.flyer_thickness_m()) /
                 (cone.zone_width_m() * cone.zone_width_m());
  if (cone.has_first_zone_m()) {
    const double nodes =
        static_cast<double>(graded_nodes(cone.confinement_radius_m(), grading_of(cone)).distance.size());
    zones += 2.0 * nodes * cone.length_m() / cone.zone_width_m();
  }
  if (zones > kMostZones) {
    refuse("hydro.cone_target.zone_width_m",
           fmt::format("about {:.3g} zones, at most {:g} are allowed", zones, kMostZones),
           cone.has_first_zone_m() ? "raise zone_width_m, first_zone_m or zone_growth" : "raise zone_width_m");
  }
  return problem;
}

lagrange::Bodies make_bodies(const ConeTarget& problem) {
  const guest::ConeTarget& cone = problem.scene;
  const auto zones = [&](double length) {
    return std::max(2, static_cast<int>(std::lround(length / cone.zone_width_m())));
  };
  lagrange::Mesh mesh(lagrange::Symmetry::kAxisymmetric);
  const int along = zones(cone.length_m());
  if (cone.has_first_zone_m()) {
    add_graded_blocks(mesh, cone, along);
  } else {
    const int across = zones(0.5 * (cone.front_radius_m() + cone.back_radius_m()));
    const int outside = zones(cone.confinement_radius_m() - 0.5 * (cone.front_radius_m() + cone.back_radius_m()));
    mesh.add_block(across, along, [&](int i, int j) {
      const double z = cone.length_m() * j / along;
      return Vec2{flank_radius(cone, z) * i / across, z};
    });
    mesh.add_block(outside, along, [&](int i, int j) {
      const double z = cone.length_m() * j / along;
      const double flank = flank_radius(cone, z);
      return Vec2{flank + (cone.confinement_radius_m() - flank) * i / outside, z};
    });
  }
  const int thick = zones(cone.flyer_thickness_m());
  const int wide = zones(cone.confinement_radius_m());
  mesh.add_block(wide, thick, [&](int i, int j) {
    return Vec2{cone.confinement_radius_m() * i / wide,
                cone.flyer_thickness_m() * (static_cast<double>(j) / thick - 1.0)};
  });

  lagrange::Bodies bodies(std::move(mesh));
  const lagrange::Block target_cone = bodies.mesh.blocks()[ConeTarget::kCone];
  const lagrange::Block confinement = bodies.mesh.blocks()[ConeTarget::kConfinement];
  const lagrange::Block flyer = bodies.mesh.blocks()[ConeTarget::kFlyer];
  bodies.materials = {body_material(problem.soft), body_material(problem.hard), body_material(problem.hard)};
  fill(bodies, target_cone, problem.soft.eos.density, 0.0, {});
  fill(bodies, confinement, problem.hard.eos.density, 0.0, {});
  fill(bodies, flyer, problem.hard.eos.density, 0.0, {0.0, cone.flyer_speed_m_per_s()});
  bodies.walls = {{target_cone.side(Side::kLeft), {1.0, 0.0}, 0.0}, {flyer.side(Side::kLeft), {1.0, 0.0}, 0.0}};
  bodies.slide_lines = {
      {surface(target_cone, Side::kRight), surface(confinement, Side::kLeft), true},
      {surface(target_cone, Side::kBottom), surface(flyer, Side::kTop), false},
      {surface(confinement, Side::kBottom), surface(flyer, Side::kTop), false},
  };
  bodies.contact.soft_share = physics::heat_partition(problem.soft.strength, problem.hard.strength);
  bodies.time_step.cfl = cone.courant();
  return bodies;
}

Problem2d make_problem2d(const ConeTarget& problem) {
  Problem2d made(make_bodies(problem));
  made.body_names = "0 cone, 1 confinement, 2 flyer";
  made.free_surface = made.bodies.mesh.blocks()[ConeTarget::kCone].side(Side::kTop);
  made.end_time = problem.end_time;
  made.history_interval = problem.scene.history_interval_s();
  made.frames = problem.scene.frames();
  made.soft = problem.soft.strength;
  made.hard = problem.hard.strength;
  made.heat_bound = problem.heat_bound;
  made.published = {.pressure = 10e9, .sliding_velocity = 400.0};  // DLP section 2
  return made;
}

}  // namespace shearbus::hydro
