#include "hydro_stub/summary2d.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

namespace shearbus::hydro {
namespace {

using lagrange::Ledger;

struct Residuals {
  double energy, momentum;
};

// Residuals of the balances of energy and momentum since the start. The energy residual is relative to the total
// energy, the momentum residual to sqrt(2 mass energy) plus the sum of |pressure| volume / sound speed. In axisymmetry
// only the axial component of momentum is conserved as a sum.
Residuals residuals(const lagrange::Cycle& cycle, const Ledger& start) {
  const Ledger end = cycle.ledger();
  const lagrange::State& state = cycle.state();
  const double energy = std::max(start.total_energy(), end.total_energy());
  double mass = 0.0, pushed = 0.0;
  for (std::size_t z = 0; z < state.mass.size(); ++z) {
    mass += state.mass[z];
    pushed += std::abs(state.pressure[z]) * state.volume[z] / state.sound_speed[z];
  }
  const double momentum = std::sqrt(2.0 * mass * std::max(0.0, energy)) + pushed;
  lagrange::Vec2 missing = end.momentum - end.impulse_given - start.momentum;
  if (cycle.mesh().symmetry() == lagrange::Symmetry::kAxisymmetric) missing.x = 0.0;
  return {energy > 0.0 ? (end.total_energy() - end.work_given - start.total_energy()) / energy : 0.0,
          momentum > 0.0 ? norm(missing) / momentum : 0.0};
}

std::string error_text(const Comparison& c) {
  return c.exact != 0.0 ? fmt::format("{:+.3f} %", 100.0 * (c.found / c.exact - 1.0)) : "";
}

}  // namespace

// What limited the slip, the load on the interface, and how much of the work that friction can do below melting it did.
std::string Summary2d::flank_text() const {
  const auto slip_in = [&](wire::Regime regime) { return 100.0 * interface.share_of_slip(regime); };
  const NodeTotals& nodes = interface.totals();
  const double fastest = *std::ranges::max_element(nodes.fastest_slip);
  std::string out = fmt::format(
      "  slip by regime          {} {:.1f} %, Tresca {:.1f} %, melting {:.1f} % of the slip distance\n", sliding_name(),
      slip_in(wire::Regime::kCoulomb), slip_in(wire::Regime::kTresca), slip_in(wire::Regime::kMelting));
  if (!slips_freely())
    for (const auto& [label, value] : regime_lines()) out += fmt::format("  {:<24}{}\n", label, value);
  out += fmt::format(
      "  flank, highest          pressure {:.2f} GPa (mean of the nodes' highest {:.2f}), slip {:.0f} m/s ({:.0f})",
      1e-9 * interface.highest_pressure(), 1e-9 * interface.mean(nodes.highest_pressure), fastest,
      interface.mean(nodes.fastest_slip));
  if (problem.published) {
    out += fmt::format("; published: up to {:.0f} GPa, {:.0f} m/s", 1e-9 * problem.published->pressure,
                       problem.published->sliding_velocity);
  }
  out += fmt::format(
      "\n  P sqrt(t) of slip       {:.2f} GPa us^(1/2): mean pressure times root of the time of slip, mean of the "
      "interface\n",
      1e-6 * interface.mean_pressure_root_time());
  if (interface.has_bound()) {
    out += fmt::format(
        "  friction below melting  did at most {:.1f} % (mean at the end {:.1f} %) of the work that an interface below "
        "melting can take up\n",
        100.0 * interface.most_bound_used(), 100.0 * interface.mean(nodes.bound_used));
  }
  return out;
}

// The displacement of metal against metal, which converges where slip gives way to shear of the metal, and the impulse.
std::string Summary2d::displacement_text() const {
  std::string bands;
  for (std::size_t band = 0; band < MetalBands::kDistances.size(); ++band) {
    if (const std::optional<double> mean = interface.mean_displacement(band))
      bands += fmt::format("{}{:.4f} mm over +-{:g} mm", bands.empty() ? "mean " : ", ", 1e3 * *mean,
                           1e3 * MetalBands::kDistances[band]);
  }
  std::string out;
  if (!bands.empty()) out += fmt::format("  metal against metal     {} of the interface\n", bands);
  return out + fmt::format("  friction impulse        mean {:.1f} Pa s\n", interface.mean_friction_impulse());
}

// Whether the interface slips on every mesh, and what was set from the mesh.
std::string Summary2d::strength_text() const {
  std::string out;
  if (problem.strength && problem.strength->cold) {
    out += fmt::format(
        "  interface strength      {:.0f} MPa cold; Y* {:.0f} MPa, which soft metal reaches at strain {:.2f}, {:.0f} "
        "K: {}\n",
        1e-6 * *problem.strength->cold, 1e-6 * problem.strength->metal.stress, problem.strength->metal.strain,
        problem.strength->metal.temperature,
        problem.strength->too_strong() ? "on fine zones the metal shears in place of slip"
                                       : "the interface slips on every mesh");
  }
  if (interface.has_critical_jump())
    out += fmt::format("  jumps above V_crit      at {} of {} nodes, which plastic waves cannot take up\n",
                       interface.nodes_above_critical_jump(), interface.nodes());
  if (!problem.layer_thickness.empty()) {
    const auto [thinnest, thickest] = std::ranges::minmax(problem.layer_thickness);
    out += fmt::format("  layers                  half a wall zone thick, {:.4g} to {:.4g} um\n", 1e6 * thinnest,
                       1e6 * thickest);
  }
  return out;
}

std::string Summary2d::text() const {
  const Ledger end = cycle.ledger();
  const bool has_axis = cycle.mesh().symmetry() == lagrange::Symmetry::kAxisymmetric;
  // Factor from the sums of the mesh to the printed totals, which are of the whole body or per metre of depth: in
  // axisymmetry the mesh stands for one radian.
  const double turn = has_axis ? 2.0 * std::numbers::pi : 1.0;
  const char* joule = has_axis ? "J" : "J/m";
  const auto [energy, momentum] = residuals(cycle, start);
  std::string out = fmt::format("{}{}\n  zones, steps            {}, {} (taken back: {})\n", scene,
                                interface.nodes() > 0 ? ", interface law " + interface_law : "",
                                cycle.mesh().num_zones(), cycle.steps(), cycle.rejected_steps());
  if (interface.nodes() > 0) {
    const auto share = [&](wire::Regime regime) { return 100.0 * interface.share(regime); };
    out += fmt::format(
        "  regime shares           open {:.1f} %, stick {:.1f} %, {} {:.1f} %, Tresca {:.1f} %, melting {:.1f} % of "
        "the node-steps\n"
        "  slip distance           mean {:.4f} mm, longest {:.4f} mm\n"
        "{}"
        "  hottest interface       {:.1f} K; highest pressure {:.3f} GPa\n"
        "  friction heat           {:.4f} {} of {:.1f} kinetic at the start; closing the gaps {:.4f}\n",
        share(wire::Regime::kOpen), share(wire::Regime::kStick), sliding_name(), share(wire::Regime::kCoulomb),
        share(wire::Regime::kTresca), share(wire::Regime::kMelting), 1e3 * interface.mean_slip(),
        1e3 * interface.longest_slip(), displacement_text(), interface.hottest(), 1e-9 * interface.highest_pressure(),
        turn * end.friction_heat, joule, turn * start.kinetic, turn * end.closing_heat);
    if (!problem.start_temperature.empty())
      out +=
          fmt::format("  layers start            at the shocked zones' {:.1f} to {:.1f} K, mean {:.1f}\n",
                      *std::ranges::min_element(problem.start_temperature),
                      *std::ranges::max_element(problem.start_temperature), interface.mean(problem.start_temperature));
    out += flank_text() + strength_text();
  }
  for (const auto& [label, value] : interface.energy().lines()) out += fmt::format("  {:<24}{}\n", label, value);
  for (const Comparison& c : comparisons) {
    out += fmt::format("  {:<36}{:.6g} {}, should be {:.6g}  {}\n", c.what, c.found, c.units, c.exact, error_text(c));
  }
  out += fmt::format("  ledger residuals        energy {:.1e}, {}momentum {:.1e}\n", energy, has_axis ? "axial " : "",
                     momentum);
  out += fmt::format("  run time                {:.2f} s, {:.2f} of the processor", seconds(time.total), time.cpu_s);
  if (interface.nodes() > 0) {
    out += fmt::format(
        "\n  interface law           {:.2f} s in the law ({:.1f} %), of which its solver {:.3f}; {:.2f} s of the "
        "host's processor ({:.1f} %)",
        seconds(time.law.service), 100.0 * time.share(time.law.service), seconds(time.law.solver),
        seconds(time.law.cpu), 100.0 * seconds(time.law.cpu) / time.cpu_s);
    if (time.law.bus.count() > 0)
      out += fmt::format(
          "\n  exchange                {:.2f} s ({:.1f} %) in calls of the client library; from sending to the answer "
          "passed {:.2f} s",
          seconds(time.law.waited), 100.0 * time.share(time.law.waited), seconds(time.law.bus + time.law.solver));
  }
  return out + fmt::format("\n  output                  {:.2f} s\n", seconds(time.output));
}

std::string Summary2d::json() const {
  const Ledger end = cycle.ledger();
  const bool has_axis = cycle.mesh().symmetry() == lagrange::Symmetry::kAxisymmetric;
  const double turn = has_axis ? 2.0 * std::numbers::pi : 1.0;
  const auto [energy, momentum] = residuals(cycle, start);
  nlohmann::ordered_json out = {{"scene", scene},
                                {"interface_law", interface_law},
                                {"provenance", as_json(provenance)},
                                {"zones", cycle.mesh().num_zones()},
                                {"steps", cycle.steps()},
                                {"steps_taken_back", cycle.rejected_steps()}};
  if (interface.nodes() > 0) {
    out["share_open"] = interface.share(wire::Regime::kOpen);
    out["share_stick"] = interface.share(wire::Regime::kStick);
    if (slips_freely()) out["share_free_slip"] = interface.share(wire::Regime::kCoulomb);
    out["share_coulomb"] = slips_freely() ? 0.0 : interface.share(wire::Regime::kCoulomb);
    out["share_tresca"] = interface.share(wire::Regime::kTresca);
    out["share_melting"] = interface.share(wire::Regime::kMelting);
    out["mean_slip_m"] = interface.mean_slip();
    out["longest_slip_m"] = interface.longest_slip();
    for (std::size_t band = 0; band < MetalBands::kDistances.size(); ++band) {
      if (const std::optional<double> mean = interface.mean_displacement(band))
        out["displacement"].push_back({{"band_m", MetalBands::kDistances[band]}, {"mean_m", *mean}});
    }
    out["mean_friction_impulse_pa_s"] = interface.mean_friction_impulse();
    if (problem.strength) {
      if (problem.strength->cold) out["interface_strength_pa"] = *problem.strength->cold;
      out["metal_peak_strength"] = {{"stress_pa", problem.strength->metal.stress},
                                    {"strain", problem.strength->metal.strain},
                                    {"temperature_k", problem.strength->metal.temperature}};
    }
    if (interface.has_critical_jump()) out["nodes_above_critical_jump"] = interface.nodes_above_critical_jump();
    out["peak_interface_temperature_k"] = interface.hottest();
    out["peak_pressure_pa"] = interface.highest_pressure();
    out[has_axis ? "friction_heat_j" : "friction_heat_j_per_m"] = turn * end.friction_heat;
    const NodeTotals& nodes = interface.totals();
    out["slip_share_coulomb"] = slips_freely() ? 0.0 : interface.share_of_slip(wire::Regime::kCoulomb);
    out["slip_share_tresca"] = interface.share_of_slip(wire::Regime::kTresca);
    out["slip_share_melting"] = interface.share_of_slip(wire::Regime::kMelting);
    out["peak_sliding_velocity_m_per_s"] = *std::ranges::max_element(nodes.fastest_slip);
    if (problem.published) {
      out["published"] = {{"pressure_pa", problem.published->pressure},
                          {"sliding_velocity_m_per_s", problem.published->sliding_velocity}};
    }
    out["slip_pressure_root_time_pa_s_half"] = interface.mean_pressure_root_time();
    out["interface"] = {{"length_m", interface.lengths()},
                        {"slip_m", nodes.slip},
                        {"peak_pressure_pa", nodes.highest_pressure},
                        {"peak_sliding_velocity_m_per_s", nodes.fastest_slip},
                        {"displacement_half_mm_m", nodes.displacement_half_mm},
                        {"displacement_one_mm_m", nodes.displacement_one_mm},
                        {"friction_impulse_pa_s", nodes.friction_impulse}};
    if (interface.has_critical_jump()) out["interface"]["critical_jump_share"] = nodes.critical_jump_share;
    if (!problem.layer_thickness.empty()) out["interface"]["layer_thickness_m"] = problem.layer_thickness;
    if (!problem.start_temperature.empty()) out["interface"]["start_temperature_k"] = problem.start_temperature;
    if (interface.has_bound()) {
      out["bound_used_most"] = interface.most_bound_used();
      out["interface"]["bound_used"] = nodes.bound_used;
    }
    out["layer_energy"] = as_json(interface.energy());
    out["service_share"] = time.share(time.law.service);
    out["waiting_share"] = time.share(time.law.waited);
    out["cpu_share"] = seconds(time.law.cpu) / time.cpu_s;
  }
  for (const Comparison& c : comparisons)
    out["comparisons"].push_back({{"what", c.what}, {"units", c.units}, {"exact", c.exact}, {"found", c.found}});
  if (!omitted.lines.empty()) out["omitted"] = as_json(omitted);
  out["energy_residual"] = energy;
  out["momentum_residual"] = momentum;
  out["run_time_s"] = seconds(time.total);
  out["cpu_time_s"] = time.cpu_s;
  return out.dump(2) + '\n';
}

}  // namespace shearbus::hydro
