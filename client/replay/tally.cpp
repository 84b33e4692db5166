#include "client/replay/tally.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <utility>

#include "proto/wire/enum_names.hpp"

namespace shearbus::replay {
namespace {

double seconds(std::chrono::nanoseconds time) {
  return std::chrono::duration<double>(time).count();
}

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

}  // namespace

Tally::Tally(const std::vector<std::uint64_t>& node_ids)
    : node_ids_(node_ids), slip_(node_ids.size(), 0.0), peaks_k_(node_ids.size(), 0.0), heat_(node_ids.size(), 0.0) {}

void Range::add(std::span<const double> values) {
  for (const double value : values) {
    lowest = std::min(lowest, value);
    highest = std::max(highest, value);
  }
}

std::string Range::text(const char* unit) const {
  const std::string low = fmt::format("{:.6g}", lowest), high = fmt::format("{:.6g}", highest);
  return low == high ? fmt::format("{} {}", low, unit) : fmt::format("{} to {} {}", low, high, unit);
}

void InputRanges::add(const Batch& request, double dt_s) {
  pressure.add(request.f64(Field::kPressure));
  for (const std::uint32_t component : {0U, 1U}) jump.add(request.f64(Field::kVelocityJump, component));
  dt.add({&dt_s, 1});
}

std::string InputRanges::text() const {
  return fmt::format("  inputs                      P {}; [V] {}; dt {}\n", pressure.text("Pa"), jump.text("m/s"),
                     dt.text("s"));
}

void Tally::add(const Batch& request, const Answer& answer, double time_s, double dt_s) {
  const Batch& columns = answer.columns;
  inputs_.add(request, dt_s);
  const auto temperature = columns.f64(Field::kInterfaceTemperature);
  const auto velocity = columns.f64(Field::kSlidingVelocity);
  const auto second_velocity = columns.f64(Field::kSlidingVelocity, 1);  // empty if slip has one component
  const auto heat = columns.f64(Field::kFrictionHeat);
  const auto regime = columns.u8(Field::kRegime);
  const auto outcome = columns.u8(Field::kOutcome);
  for (std::size_t node = 0; node < node_ids_.size(); ++node) {
    if (regime[node] != static_cast<std::uint8_t>(wire::Regime::kOpen))  // an open contact has a velocity, too
      slip_[node] += std::hypot(velocity[node], second_velocity.empty() ? 0.0 : second_velocity[node]) * dt_s;
    peaks_k_[node] = std::max(peaks_k_[node], temperature[node]);
    heat_[node] += heat[node];
    if (temperature[node] > peak_temperature_k_) {
      peak_temperature_k_ = temperature[node];
      peak_time_s_ = time_s;
      peak_node_ = node;
    }
    if (regime[node] < wire::kRegimeCount) ++regimes_[regime[node]];
    if (regime[node] == static_cast<std::uint8_t>(wire::Regime::kMelting) && !first_melting_s_) {
      first_melting_s_ = time_s;
      first_melting_node_ = node;
    }
    flagged_ += (outcome[node] & ~wire::kAsleep) != wire::kOutcomeOk;
    for (std::size_t bit = 0; bit < outcomes_.size(); ++bit) outcomes_[bit] += (outcome[node] >> bit) & 1u;
  }
  energy_.add(columns);
  node_steps_ += node_ids_.size();
}

std::string Tally::regimes_text() const {
  std::vector<std::string> shares;
  for (std::size_t i = 0; i < wire::kRegimeCount; ++i)
    if (regimes_[i] > 0)
      shares.push_back(fmt::format("{} {:.1f} %", wire::regime_name(i),
                                   100.0 * static_cast<double>(regimes_[i]) / static_cast<double>(node_steps_)));
  return fmt::format("{} of {} node-steps", fmt::join(shares, ", "), node_steps_);
}

std::string Tally::outcomes_text() const {
  if (flagged_ == 0) return "none";
  constexpr std::array<std::pair<std::size_t, const char*>, 6> kBits = {{{0, "substepped"},
                                                                         {1, "with several roots"},
                                                                         {2, "outside the strategy's domain"},
                                                                         {3, "changing suddenly"},
                                                                         {6, "of first order in place of second"},
                                                                         {kFailedBit, "FAILED"}}};
  std::vector<std::string> counts;
  for (const auto& [bit, text] : kBits)
    if (outcomes_[bit] > 0) counts.push_back(fmt::format("{} {}", outcomes_[bit], text));
  return fmt::format("{} node-steps ({:.2f} %): {}; see /outcome", flagged_,
                     100.0 * static_cast<double>(flagged_) / static_cast<double>(node_steps_), fmt::join(counts, ", "));
}

std::string Tally::text(const RunTime& time) const {
  const auto most_slip = std::max_element(slip_.begin(), slip_.end());
  const auto id = [&](std::size_t node) { return node_ids_[node]; };
  std::string text = inputs_.text();
  text += fmt::format("  peak interface temperature  {:.3f} K, node {}, at {:.6g} s\n", peak_temperature_k_,
                      id(peak_node_), peak_time_s_);
  if (first_melting_s_)
    text +=
        fmt::format("  0.99 T_melt first reached   at {:.6g} s, node {}\n", *first_melting_s_, id(first_melting_node_));
  text += fmt::format("  slip distance               {:.6g} m mean, {:.6g} m at node {}\n", mean(slip_), *most_slip,
                      id(static_cast<std::size_t>(most_slip - slip_.begin())));
  text += fmt::format("  friction heat in the layer  {:.6g} J/m2 mean, {:.6g} J/m2 most\n", mean(heat_),
                      *std::max_element(heat_.begin(), heat_.end()));
  for (const auto& [label, value] : energy_.lines()) text += fmt::format("  {:<28}{}\n", label, value);
  text += fmt::format("  regimes                     {}\n", regimes_text());
  text += fmt::format("  flagged                     {}\n", outcomes_text());
  text += fmt::format(
      "  run time                    {:.3f} s: reading {:.3f}, bus {:.3f}, solver {:.3f}, writing {:.3f} s\n",
      seconds(time.total), seconds(time.reading), seconds(time.bus), seconds(time.solver), seconds(time.writing));
  return text;
}

void Tally::add_to(nlohmann::ordered_json& summary, const RunTime& time) const {
  const auto most_slip = std::max_element(slip_.begin(), slip_.end());
  const auto id = [&](std::size_t node) { return node_ids_[node]; };
  for (const auto& [name, range] :
       {std::pair("pressure_pa", &inputs_.pressure), {"velocity_jump_m_per_s", &inputs_.jump}, {"dt_s", &inputs_.dt}}) {
    summary["inputs"][name]["lowest"] = range->lowest;
    summary["inputs"][name]["highest"] = range->highest;
  }
  summary["peak_interface_temperature_k"] = peak_temperature_k_;
  summary["peak_node"] = id(peak_node_);
  summary["peak_time_s"] = peak_time_s_;
  if (first_melting_s_) {
    summary["first_melting_time_s"] = *first_melting_s_;
    summary["first_melting_node"] = id(first_melting_node_);
  }
  summary["slip_distance_mean_m"] = mean(slip_);
  summary["slip_distance_longest_m"] = *most_slip;
  summary["friction_heat_mean_j_per_m2"] = mean(heat_);
  summary["friction_heat_most_j_per_m2"] = *std::max_element(heat_.begin(), heat_.end());
  for (const wire::Field term : wire::kLedgerColumns)
    if (!energy_.empty()) summary["layer_energy"][name(term)] = energy_.mean(term);
  for (std::size_t i = 0; i < wire::kRegimeCount; ++i)
    summary["node_step_share"][wire::regime_name(i)] =
        static_cast<double>(regimes_[i]) / static_cast<double>(node_steps_);
  summary["node_steps"] = node_steps_;
  summary["flagged_node_steps"] = flagged_;
  summary["failed_node_steps"] = failed_node_steps();
  summary["run_time_s"] = seconds(time.total);
  summary["solver_time_s"] = seconds(time.solver);
}

}  // namespace shearbus::replay
