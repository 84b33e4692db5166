#include "hydro_stub/summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <utility>

#include "proto/wire/enum_names.hpp"
#include "proto/wire/text.hpp"
#include "server/physics/material/strength.hpp"

namespace shearbus::hydro {
namespace {

constexpr double kSame = 1e-9;  // relative difference of sums of the same numbers
constexpr auto kCoulomb = static_cast<std::size_t>(wire::Regime::kCoulomb);

double length_of(const BodyMesh& mesh) {
  if (mesh.widths.empty()) return mesh.zone_width * static_cast<double>(mesh.zones);
  return std::accumulate(mesh.widths.begin(), mesh.widths.end(), 0.0);
}

// Returns a residual relative to the sum of the magnitudes in its balance; 0 if the balance has no terms.
double relative(double residual, double magnitude) {
  return magnitude > 0.0 ? std::abs(residual) / magnitude : std::abs(residual);
}

}  // namespace

Summary::Summary(const ColumnProblem& problem, std::string interface_law, server::Entries provenance)
    : problem_(problem),
      interface_law_(std::move(interface_law)),
      provenance_(std::move(provenance)),
      melting_time_(problem.columns, -1.0),
      slip_(problem.columns, 0.0),
      friction_impulse_(problem.columns, 0.0) {
  for (std::size_t b = 0; b < kBands.size(); ++b) {
    const auto soft = place_at(problem.soft, kBands[b]);
    const auto hard = place_at(problem.hard, kBands[b]);
    if (!soft || !hard) continue;
    bands_[b].places = {*soft, *hard};
    bands_[b].displacement.assign(problem.columns, 0.0);
  }
}

double Summary::melting_threshold(double pressure) const {
  const bool rises = problem_.soft_material.melting_curve != physics::MeltingCurve::kConstant;
  return physics::kMeltingShare * (rises ? physics::at_pressure(problem_.soft_material, pressure).melting_temperature
                                         : problem_.soft_material.melting_temperature);
}

double Summary::heat_partition() const {
  return physics::heat_partition(problem_.soft_material, problem_.hard_material);
}

double Summary::heat_into_soft() const {
  return energy_.empty() ? heat_ : energy_.mean(wire::Field::kHeatToSoft) * static_cast<double>(problem_.columns);
}

void Summary::observe(const ShearColumn& column) {
  const InterfaceAnswer& answer = column.answer();
  const double dt = column.inputs().dt;
  for (std::size_t i = 0; i < problem_.columns; ++i) {
    const double temperature = answer.interface_temperature[i];
    if (temperature > peak_.value) peak_ = {.node = i, .time = column.time(), .value = temperature};
    if (melting_time_[i] < 0.0 && temperature >= melting_threshold(column.inputs().pressure[i]))
      melting_time_[i] = column.time();
    if (answer.regime[i] != static_cast<std::uint8_t>(wire::Regime::kOpen)) {  // an open contact has a velocity, too
      slip_[i] += std::abs(answer.sliding_velocity[i]) * dt;
      friction_work_ += answer.shear_stress[i] * answer.sliding_velocity[i] * dt;
    }
    friction_impulse_[i] += answer.shear_stress[i] * dt;
    ++regime_count_[answer.regime[i]];
    heat_ += answer.friction_heat[i];
  }
  for (Band& band : bands_) {
    if (!band.places) continue;
    for (std::size_t i = 0; i < problem_.columns; ++i)
      band.displacement[i] +=
          dt * (velocity_at(column.soft(), band.places->first, i) - velocity_at(column.hard(), band.places->second, i));
  }
  energy_.add(answer.energy);
  flagged_ += answer.flagged;
}

void Summary::finish(const ShearColumn& column, const RunTime& time) {
  steps_ = column.step();
  end_time_ = column.time();
  time_ = time;
  for (std::size_t i = 0; i < problem_.columns; ++i) {
    const ShearColumn::Ledger ledger = column.ledger(i);
    interface_work_ += ledger.friction_work;
    momentum_residual_ =
        std::max(momentum_residual_,
                 relative(ledger.momentum_residual(), std::abs(ledger.momentum_start) + std::abs(ledger.momentum_end) +
                                                          std::abs(ledger.impulse_of_far_ends)));
    energy_residual_ = std::max(
        energy_residual_,
        relative(ledger.energy_residual(), ledger.energy_start + ledger.energy_end + std::abs(ledger.friction_work) +
                                               std::abs(ledger.plastic_work) + std::abs(ledger.work_of_far_ends)));
  }
}

std::string Summary::text() const {
  std::string out;
  const auto line = [&](const char* label, const std::string& value) {
    out += fmt::format("  {:<24}{}\n", label, value);
  };
  const double node_steps = static_cast<double>(steps_) * static_cast<double>(problem_.columns);
  out += fmt::format("{}, interface law {}\n", problem_.name, interface_law_);
  line("columns, steps", fmt::format("{}, {} of {:.6g} ns ({}), to {:.6g} µs", problem_.columns, steps_,
                                     problem_.dt * 1e9, problem_.dt_reason, end_time_ * 1e6));
  line("bodies", fmt::format("soft {:.4g} mm in {} zones, hard {:.4g} mm in {} zones; {}",
                             length_of(problem_.soft) * 1e3, problem_.soft.zones, length_of(problem_.hard) * 1e3,
                             problem_.hard.zones, problem_.yields ? "the soft one yields" : "elastic"));
  line("peak temperature",
       fmt::format("{:.2f} K in column {} at {:.6g} µs", peak_.value, peak_.node, peak_.time * 1e6));
  const auto melted = std::ranges::count_if(melting_time_, [](double t) { return t >= 0.0; });
  if (melted > 0) {
    double first = end_time_;
    for (const double t : melting_time_) first = t >= 0.0 ? std::min(first, t) : first;
    line("0.99 T_melt", fmt::format("reached by {} of {}, first at {:.6g} µs", melted,
                                    wire::counted(problem_.columns, "column"), first * 1e6));
  } else {
    line("0.99 T_melt", fmt::format("not reached ({:.1f} K at rest)", melting_threshold(0.0)));
  }
  const auto range = [&](const std::vector<double>& values, double scale, const char* unit) {
    const auto [least, most] = std::ranges::minmax_element(values);
    return problem_.columns == 1 ? fmt::format("{:.6g} {}", *least * scale, unit)
                                 : fmt::format("{:.6g} to {:.6g} {}", *least * scale, *most * scale, unit);
  };
  line("slip distance", range(slip_, 1e6, "µm"));
  for (std::size_t b = 0; b < kBands.size(); ++b) {
    if (bands_[b].places)
      line("metal against metal",
           fmt::format("{} over +-{:g} mm", range(bands_[b].displacement, 1e6, "µm"), kBands[b] * 1e3));
  }
  line("friction impulse", range(friction_impulse_, 1.0, "Pa s"));
  std::string shares;
  for (std::size_t i = 1; i <= regime_count_.size(); ++i) {
    const std::size_t r = i % regime_count_.size();  // 0, open, last
    const std::string regime = r == kCoulomb && slips_freely() ? "free slip" : wire::regime_name(r);
    shares += fmt::format("{}{} {:.1f} %", shares.empty() ? "" : ", ", regime,
                          100.0 * static_cast<double>(regime_count_[r]) / node_steps);
  }
  line("node-steps", shares);
  if (!slips_freely())
    for (const auto& [label, value] : regime_lines()) line(label.c_str(), value);
  const double soft_heat = heat_into_soft();
  const bool shared = relative(soft_heat - heat_, heat_) <= kSame;  // by the fixed partition, else both bodies conduct
  line("friction work",
       fmt::format("{:.6g} kJ/m2 of the slip, heat into the soft body {:.6g} kJ/m2{}, all columns",
                   friction_work_ * 1e-3, soft_heat * 1e-3,
                   shared ? fmt::format(" (heat partition {:.4f})", heat_partition()) : std::string()));
  if (relative(interface_work_ - friction_work_, std::abs(friction_work_)) > kSame)
    line("interface work", fmt::format("{:.6g} kJ/m2 of the stress on the jump, all columns", interface_work_ * 1e-3));
  for (const auto& [label, value] : energy_.lines()) line(label.c_str(), value);
  line("momentum ledger", fmt::format("closed to {:.1e}", momentum_residual_));
  line("energy ledger", fmt::format("closed to {:.1e} (kinetic + elastic + friction + far ends)", energy_residual_));
  if (flagged_ > 0) line("remarks", fmt::format("{} node-steps were substepped or had several answers", flagged_));
  const double total = seconds(time_.total);
  const auto share = [&](std::chrono::nanoseconds part) { return 100.0 * time_.share(part); };
  line("run time", fmt::format("{:.3g} s: solver {:.0f} %, round trips without the solver {:.0f} %, hydro {:.0f} %, "
                               "output {:.0f} %; {:.3g} node-steps/s",
                               total, share(time_.law.solver), share(time_.law.bus), share(time_.hydro()),
                               share(time_.output), node_steps / total));
  return out;
}

std::string Summary::json() const {
  const double node_steps = static_cast<double>(steps_) * static_cast<double>(problem_.columns);
  nlohmann::ordered_json shares;
  auto melting_times = nlohmann::ordered_json::array();
  for (std::size_t r = 0; r < regime_count_.size(); ++r)
    shares[r == kCoulomb && slips_freely() ? "free_slip" : wire::regime_name(r)] =
        static_cast<double>(regime_count_[r]) / node_steps;
  for (const double time : melting_time_)
    melting_times.push_back(time < 0.0 ? nlohmann::ordered_json() : nlohmann::ordered_json(time));
  nlohmann::ordered_json out = {{"scene", problem_.name},
                                {"interface_law", interface_law_},
                                {"provenance", as_json(provenance_)},
                                {"columns", problem_.columns},
                                {"steps", steps_},
                                {"dt_s", problem_.dt},
                                {"dt_limit", problem_.dt_reason},
                                {"end_time_s", end_time_},
                                {"peak_interface_temperature_k", peak_.value},
                                {"peak_node", peak_.node},
                                {"peak_time_s", peak_.time},
                                {"melting_threshold_k", melting_threshold(0.0)},
                                {"time_to_melting_threshold_s", melting_times},
                                {"slip_distance_m", slip_},
                                {"node_step_share", shares},
                                {"friction_work_j_per_m2", friction_work_},
                                {"interface_work_j_per_m2", interface_work_},
                                {"heat_into_soft_body_j_per_m2", heat_into_soft()},
                                {"heat_partition", heat_partition()}};
  for (std::size_t b = 0; b < kBands.size(); ++b) {
    if (bands_[b].places)
      out["displacement"].push_back({{"band_m", kBands[b]}, {"displacement_m", bands_[b].displacement}});
  }
  out["friction_impulse_pa_s"] = friction_impulse_;
  if (!energy_.empty()) out["layer_energy"] = as_json(energy_);
  if (!omitted_.lines.empty()) out["omitted"] = as_json(omitted_);
  out["momentum_residual"] = momentum_residual_;
  out["energy_residual"] = energy_residual_;
  out["flagged_node_steps"] = flagged_;
  out["run_time_s"] = seconds(time_.total);
  out["solver_time_s"] = seconds(time_.law.solver);
  out["bus_time_s"] = seconds(time_.law.bus);
  out["hydro_time_s"] = seconds(time_.hydro());
  out["output_time_s"] = seconds(time_.output);
  return out.dump(2) + '\n';
}

}  // namespace shearbus::hydro
