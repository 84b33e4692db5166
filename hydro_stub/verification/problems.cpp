#include "hydro_stub/verification/problems.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "hydro_stub/grading.hpp"
#include "hydro_stub/problem.hpp"

namespace shearbus::hydro {
namespace {

lagrange::Symmetry symmetry_of(guest::Symmetry symmetry) {
  return symmetry == guest::SYMMETRY_AXISYMMETRIC ? lagrange::Symmetry::kAxisymmetric : lagrange::Symmetry::kPlane;
}

template <typename Problem>
Problem2d ready(const Problem& problem, std::string body_names) {
  Problem2d made(make_bodies(problem));
  made.body_names = std::move(body_names);
  made.compare = [problem](const lagrange::Cycle& cycle) { return compare(problem, cycle); };
  if constexpr (requires { free_surface(problem, made.bodies); })
    made.free_surface = free_surface(problem, made.bodies);
  return made;
}

Problem2d piston(const guest::HydroScene& scene) {
  const guest::Piston& given = scene.hydro().piston();
  return ready(PistonProblem{.symmetry = symmetry_of(given.symmetry()),
                             .metal = make_metal(scene.scene().soft(), "soft"),
                             .length = given.length_m(),
                             .zones = static_cast<int>(given.zones()),
                             .speed = given.speed_m_per_s()},
               "0 metal");
}

Problem2d flyer_impact(const guest::HydroScene& scene) {
  const guest::FlyerImpact& given = scene.hydro().flyer_impact();
  return ready(FlyerProblem{.symmetry = symmetry_of(given.symmetry()),
                            .target = make_metal(scene.scene().soft(), "soft"),
                            .flyer = make_metal(scene.scene().hard(), "hard"),
                            .length = given.length_m(),
                            .zones = static_cast<int>(given.zones()),
                            .speed = given.speed_m_per_s(),
                            .flyer_length = given.flyer_length_m()},
               "0 target, 1 flyer");
}

Problem2d implosion(const guest::HydroScene& scene) {
  const guest::Implosion& given = scene.hydro().implosion();
  if (!(given.stop_radius_m() < given.inner_radius_m() && given.inner_radius_m() < given.outer_radius_m()))
    refuse("hydro.implosion.stop_radius_m",
           fmt::format("radii {} < {} < {} m do not increase", given.stop_radius_m(), given.inner_radius_m(),
                       given.outer_radius_m()),
           "stop_radius_m < inner_radius_m < outer_radius_m");
  const ImplosionProblem problem{.sphere = given.shell() == guest::SHELL_SPHERE,
                                 .symmetry = symmetry_of(given.symmetry()),
                                 .metal = make_metal(scene.scene().soft(), "soft"),
                                 .inner = given.inner_radius_m(),
                                 .outer = given.outer_radius_m(),
                                 .stop = given.stop_radius_m(),
                                 .zones = static_cast<int>(given.zones())};
  Problem2d made = ready(problem, "0 shell");
  made.over = [problem](const lagrange::Cycle& cycle) { return at_rest(problem, cycle); };
  return made;
}

Problem2d gas_flow(const guest::HydroScene& scene) {
  const guest::GasFlow& given = scene.hydro().gas_flow();
  const int zones = static_cast<int>(given.zones());
  const lagrange::Symmetry symmetry = symmetry_of(given.symmetry());
  switch (given.test()) {
    case guest::GAS_TEST_SEDOV:
      return ready(SedovProblem{symmetry, zones}, "0 gas");
    case guest::GAS_TEST_SALTZMAN:
      if (symmetry != lagrange::Symmetry::kPlane)
        refuse("hydro.gas_flow.symmetry", "saltzman's channel is plane", "leave symmetry out");
      return ready(SaltzmanProblem{zones}, "0 gas");
    default:
      break;
  }
  return ready(NohProblem{symmetry, zones}, "0 gas");
}

Problem2d taylor_bar(const guest::HydroScene& scene) {
  const guest::TaylorBar& given = scene.hydro().taylor_bar();
  return ready(TaylorProblem{.metal = make_metal(scene.scene().soft(), "soft"),
                             .radius = given.radius_m(),
                             .length = given.length_m(),
                             .speed = given.speed_m_per_s(),
                             .zones = static_cast<int>(given.zones())},
               "0 bar");
}

Problem2d sliding_plates(const guest::HydroScene& scene) {
  const guest::SlidingPlates& given = scene.hydro().sliding_plates();
  PlatesProblem problem{.soft = make_metal(scene.scene().soft(), "soft"),
                        .hard = make_metal(scene.scene().hard(), "hard"),
                        .length = given.length_m(),
                        .soft_depth = given.soft_depth_m(),
                        .hard_depth = given.hard_depth_m(),
                        .width = given.zone_width_m(),
                        .jump = given.velocity_jump_m_per_s(),
                        .angle = given.angle_deg() * std::numbers::pi / 180.0,
                        .pressure = given.pressure_pa()};
  if (!(4.0 * problem.width <= std::min({problem.length, problem.soft_depth, problem.hard_depth})))
    refuse("hydro.sliding_plates.zone_width_m",
           fmt::format("zones of {} m do not go four times into length and depths", problem.width),
           "lower zone_width_m");
  if (given.has_first_zone_m())
    problem.first = checked_grading("hydro.sliding_plates", true, given.first_zone_m(), given.zone_growth(),
                                    given.zone_width_m(), std::max(problem.soft_depth, problem.hard_depth))
                        .first;
  problem.growth = given.zone_growth();
  Problem2d made(make_bodies(problem));
  made.body_names = "0 soft, 1 hard";
  const auto limit = [&]() -> std::optional<double> {
    switch (scene.hydro().interface_law()) {
      case guest::INTERFACE_LAW_FREE_SLIP:
        return 0.0;
      case guest::INTERFACE_LAW_STICK:
        return std::numeric_limits<double>::infinity();
      case guest::INTERFACE_LAW_CONSTANT:
        return scene.hydro().constant_shear_stress_pa();
      default:
        return std::nullopt;
    }
  }();
  if (limit) made.compare = [=](const lagrange::Cycle& cycle) { return compare(problem, cycle, *limit); };
  made.soft = problem.soft.strength;
  made.hard = problem.hard.strength;
  return made;
}

}  // namespace

Problem2d make_verification(const guest::HydroScene& scene) {
  const guest::Hydro& hydro = scene.hydro();
  Problem2d made = hydro.has_piston()         ? piston(scene)
                   : hydro.has_flyer_impact() ? flyer_impact(scene)
                   : hydro.has_implosion()    ? implosion(scene)
                   : hydro.has_gas_flow()     ? gas_flow(scene)
                   : hydro.has_taylor_bar()   ? taylor_bar(scene)
                                              : sliding_plates(scene);
  made.end_time = hydro.end_time_s();
  constexpr double kRows = 200.0, kRowsOfASurface = 1000.0;  // a velocimeter resolves the rise of a shock
  made.history_interval = hydro.end_time_s() / (made.free_surface.empty() ? kRows : kRowsOfASurface);
  made.frames = 10;
  return made;
}

}  // namespace shearbus::hydro
