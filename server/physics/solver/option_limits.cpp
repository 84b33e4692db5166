#include "server/physics/solver/option_limits.hpp"

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/text.hpp"

namespace shearbus::physics {
namespace {

// A check of one option alone: returns a refusal, or nothing if the value of the option is allowed.
using Limit = std::optional<Refusal> (*)(const ModelOptions&);

std::optional<Refusal> most_cells(std::string key, int most, int found) {
  if (found <= most) return {};
  std::string text = text_of(key, " works with at most ", most, " cells, found ", found);
  return Refusal{std::move(key), std::move(text), "Take fewer cells that grow with the depth (layer.grading)."};
}

// What only a layer that flows has.
std::optional<Refusal> rigid_layer(const ModelOptions& o, bool given, std::string key, std::string text) {
  if (!given || o.strategy != Strategy::kForceDriven || o.plastic_layer) return {};
  return Refusal{std::move(key), std::move(text), "Leave it out, or set interface.plastic_layer = true."};
}

std::optional<Refusal> of_soft_body(bool given_to_hard, std::string_view option) {
  if (!given_to_hard) return {};
  std::string key = text_of("hard.", option);
  std::string text = text_of(key, " changes the strength of a body, and only that of the soft body is computed");
  return Refusal{std::move(key), std::move(text), "Give it to [soft]."};
}

// A table of k(T) or c(T) must reach from the temperature of the start to melting.
std::optional<Refusal> short_table(const ModelOptions& o) {
  for (const HeatTableKeys& keys : kHeatTables) {
    const std::vector<double>& rows = (heat_tables(o).*keys.table).temperature;
    if (rows.empty()) continue;
    if (rows.front() <= o.initial_temperature && rows.back() >= o.soft.melting_temperature) continue;
    return Refusal{keys.temperatures,
                   text_of(keys.temperatures, " reaches from ", rows.front(), " to ", rows.back(),
                           " K, and the bodies from the start at ", o.initial_temperature, " K to melting at ",
                           o.soft.melting_temperature, " K"),
                   "Give the table rows for that range."};
  }
  return {};
}

constexpr std::array<Limit, 10> kLimits = {
    short_table,
    [](const ModelOptions& o) {
      return rigid_layer(o, o.inertia, "layer.inertia",
                         "layer.inertia = true lets waves cross the layer, and a layer that is rigid moves with the "
                         "soft body, whose mass has its own already");
    },
    [](const ModelOptions& o) {
      return rigid_layer(o, o.taylor_quinney_factor.has_value(), "interface.taylor_quinney_factor",
                         "interface.taylor_quinney_factor heats where the layer flows, and a layer that is rigid does "
                         "no plastic work");
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      if (!o.inertia) return {};
      return most_cells("layer.inertia", kMaxInertiaCells, o.grid.cells);
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      if (!o.sleep) return {};
      return most_cells("layer.sleep", kMaxSleepCells, o.grid.cells + (o.hard_grid ? o.hard_grid->cells : 0));
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      if (!o.modes || !(o.modes->longest_time < o.modes->shortest_step)) return {};
      return Refusal{"layer.modes.longest_time_s",
                     text_of("layer.modes.longest_time_s = ", o.modes->longest_time,
                             " s is below layer.modes.shortest_step_s = ", o.modes->shortest_step, " s"),
                     "Give a longest_time_s of at least shortest_step_s."};
    },
    [](const ModelOptions& o) {
      return of_soft_body(o.hard.melting_curve != MeltingCurve::kConstant, "melting_curve");
    },
    [](const ModelOptions& o) { return of_soft_body(o.hard.pressure_term != PressureTerm::kLinear, "pressure_term"); },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      const std::string_view missing = constant_missing_for_options(o.soft);
      if (missing.empty()) return {};
      const std::string key = "soft." + std::string(missing);
      return Refusal{
          key,
          key + (o.soft.melting_curve == MeltingCurve::kSimon && missing.starts_with("simon")
                     ? " is missing: melting_curve = \"simon\" needs the constants of the curve"
                     : " is missing: melting_curve = \"lindemann\" and pressure_term = \"compressed\" need the "
                       "compression at a pressure"),
          "Give it, or leave both options at their defaults."};
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      const LawFault fault = FrictionLaws::with(
          o.interface.friction_law, [&](auto own) { return decltype(own)::type::fault_of(o.interface, o.soft); });
      if (fault.field.empty()) return {};
      const std::string key = "interface." + std::string(fault.field);
      return Refusal{key, key + ": " + std::string(fault.text), "Give a value within these bounds."};
    },
};

}  // namespace

void add_refused_values(const ModelOptions& options, std::vector<Refusal>& found) {
  for (const Limit limit : kLimits)
    if (std::optional<Refusal> refusal = limit(options)) found.push_back(*std::move(refusal));
}

}  // namespace shearbus::physics
