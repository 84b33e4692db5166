#include "hydro_stub/problem.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "hydro_stub/grading.hpp"
#include "proto/scene/scene.hpp"
#include "proto/wire/status.hpp"
#include "server/physics/material/flow_laws.hpp"

namespace shearbus::hydro {

[[noreturn]] void refuse(std::string field, std::string text, std::string remedy) {
  throw wire::Error({.code = wire::Code::kInvalidScene,
                     .text = std::move(text),
                     .remedy = std::move(remedy),
                     .field = std::move(field)});
}

physics::Material resolve(const v1::Body& body, const std::string& table) {
  physics::MaterialResult result = physics::make_material(
      body.material(), scene::numbers_of(body), physics::FlowLaws::numbered(static_cast<int>(body.flow_law())));
  if (!result.fault.empty()) refuse(table + "." + result.fault_field, result.fault, "");
  if (body.melting_curve() == v1::MELTING_CURVE_LINDEMANN)
    choose_melting_curve(result.material, physics::MeltingCurve::kLindemann);
  if (body.melting_curve() == v1::MELTING_CURVE_SIMON)
    choose_melting_curve(result.material, physics::MeltingCurve::kSimon);
  if (body.pressure_term() == v1::PRESSURE_TERM_COMPRESSED)
    result.material.pressure_term = physics::PressureTerm::kCompressed;
  if (const std::string_view missing = physics::constant_missing_for_options(result.material); !missing.empty())
    refuse(fmt::format("{}.{}", table, missing), fmt::format("{}.{} is missing", table, missing),
           "give it, or a material of the catalog that has it");
  return result.material;
}

namespace {

using Values = google::protobuf::RepeatedField<double>;

std::vector<double> list(const Values& values) {
  return {values.begin(), values.end()};
}

// Spreads the lists of values in [hydro.shear_column] to one value per column.
void choose_columns(const guest::ShearColumn& column, double layer_temperature, ColumnProblem& problem) {
  const std::vector<double> jumps = list(column.velocity_jump_m_per_s());
  const std::vector<double> temperatures = column.initial_temperature_k().empty()
                                               ? std::vector<double>{layer_temperature}
                                               : list(column.initial_temperature_k());
  const bool in_time = !column.pressure_time_s().empty();
  const std::vector<double> pressures = in_time ? std::vector<double>{0.0} : list(column.pressure_pa());
  const bool combined = column.lists() == guest::LISTS_COMBINED;
  problem.columns = combined ? jumps.size() * temperatures.size() * pressures.size()
                             : std::max({jumps.size(), temperatures.size(), pressures.size()});
  // Combined lists give one column for each combination of their values: the first list advances from column to column,
  // each later list only when all lists before it have run through. Paired lists advance together; a list of one value
  // holds for all columns.
  std::size_t stride = 1;
  const auto spread = [&](const std::vector<double>& values_of_list) {
    std::vector<double> values(problem.columns);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = values_of_list[i / stride % values_of_list.size()];
    if (combined) stride *= values_of_list.size();
    return values;
  };
  problem.initial_jump = spread(jumps);
  problem.initial_temperature = spread(temperatures);
  problem.pressure = in_time ? PressureHistory{list(column.pressure_time_s()), list(column.pressure_pa())}
                             : PressureHistory{{}, spread(pressures)};
}

BodyMesh mesh_of(const physics::Material& material, std::size_t columns, guest::FarEnd far_end) {
  return {.columns = columns, .density = material.density, .shear_modulus = material.shear_modulus, .far_end = far_end};
}

// Graded zones: the two bodies have equally many.
void grade_bodies(const guest::ShearColumn& column, ColumnProblem& problem) {
  const Grading grading = checked_grading("hydro.shear_column", true, column.first_zone_m(), column.zone_growth(),
                                          column.length_m() / column.zones(), column.length_m());
  const std::vector<double> nodes = graded_nodes(column.length_m(), grading).distance;
  const double ratio = problem.hard.wave_speed() / problem.soft.wave_speed();
  for (std::size_t j = 0; j + 1 < nodes.size(); ++j) {
    problem.soft.widths.push_back(nodes[j + 1] - nodes[j]);
    problem.hard.widths.push_back(ratio * problem.soft.widths.back());
  }
  problem.soft.zones = problem.hard.zones = problem.soft.widths.size();
  problem.soft.zone_width = problem.soft.widths.front();
  problem.hard.zone_width = problem.hard.widths.front();
}

// A shear wave crosses a zone of the hard body in the same time as a zone of the soft body. The number of zones of the
// hard body is chosen so that the two bodies are as nearly as possible of equal length.
void mesh_bodies(const guest::ShearColumn& column, ColumnProblem& problem) {
  if (column.has_first_zone_m()) return grade_bodies(column, problem);
  problem.soft.zones = column.zones();
  problem.soft.zone_width = column.length_m() / column.zones();
  problem.hard.zone_width = problem.soft.transit_time() * problem.hard.wave_speed();
  const double fit = std::round(column.length_m() / problem.hard.zone_width);
  problem.hard.zones = std::max<std::size_t>(2, static_cast<std::size_t>(fit));
}

void choose_steps(const guest::Hydro& hydro, ColumnProblem& problem) {
  const double transit = problem.soft.transit_time();
  const double limit = hydro.cfl() * transit;
  problem.dt = hydro.has_dt_s() ? hydro.dt_s() : limit;
  problem.dt_reason = hydro.has_dt_s() ? "the scene's dt_s" : fmt::format("cfl {:g} of the shear wave", hydro.cfl());
  if (problem.dt > limit) {
    refuse(
        "hydro.dt_s",
        fmt::format("dt_s = {:.9g} s is above the limit {:.9g} s (cfl {:g}; a shear wave crosses a zone in {:.9g} s)",
                    problem.dt, limit, hydro.cfl(), transit),
        "lower dt_s, or leave it out: it then follows from cfl");
  }
  if (problem.dt > hydro.end_time_s())
    refuse("hydro.end_time_s",
           fmt::format("end_time_s = {} s is shorter than one step of {:.6g} s ({})", hydro.end_time_s(), problem.dt,
                       problem.dt_reason),
           "check shear_column.length_m, in m, and take more zones");
  // Velocities are defined at the times (k - 1/2) dt, k = 1, 2, ...; the run ends at the first of these times at or
  // after the end time. The tolerance 1e-9 avoids one more step where rounding lifts the ratio just above a whole
  // number.
  const double exact = hydro.end_time_s() / problem.dt + 0.5;
  const double steps = std::max(1.0, std::ceil(exact - 1e-9));
  constexpr double kMostSteps = 1e9;
  if (!(steps <= kMostSteps)) {
    refuse("hydro.end_time_s",
           fmt::format("the run would take {:.3g} steps of {:.3g} s, at most {:g} are allowed", steps, problem.dt,
                       kMostSteps),
           "check end_time_s, dt_s and the zones");
  }
  problem.steps = static_cast<std::uint64_t>(steps);
}

}  // namespace

ColumnProblem make_problem(const guest::HydroScene& scene) {
  if (!scene.has_hydro()) refuse("hydro", "the scene has no [hydro] table", "add [hydro] and [hydro.shear_column]");
  if (!scene.hydro().has_shear_column())
    refuse("hydro.shear_column", "[hydro] names no problem", "add [hydro.shear_column]");
  const guest::ShearColumn& column = scene.hydro().shear_column();

  ColumnProblem problem;
  problem.name = scene.scene().name();
  choose_columns(column, scene.scene().layer().initial_temperature_k(), problem);

  problem.soft_material = resolve(scene.scene().soft(), "soft");
  problem.hard_material = resolve(scene.scene().hard(), "hard");
  problem.soft = mesh_of(problem.soft_material, problem.columns, column.far_end());
  problem.hard = mesh_of(problem.hard_material, problem.columns, column.far_end());
  mesh_bodies(column, problem);
  problem.yields = column.bulk() == guest::BULK_PLASTIC;
  problem.law_has_layers = scene.hydro().interface_law() == guest::INTERFACE_LAW_SUBGRID;
  problem.conducts_across = scene.hydro().interface_law() == guest::INTERFACE_LAW_STICK;
  choose_steps(scene.hydro(), problem);
  return problem;
}

}  // namespace shearbus::hydro
