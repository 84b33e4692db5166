// The history of the interface nodes of a two-dimensional run.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include "hydro_stub/history_rows.hpp"
#include "hydro_stub/interface_line.hpp"
#include "hydro_stub/lagrange/cycle.hpp"
#include "hydro_stub/metal_bands.hpp"
#include "hydro_stub/problem2d.hpp"
#include "proto/files/energy_totals.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::hydro {

// What happened to each interface node from the start to the last step: one value per node.
struct NodeTotals {
  explicit NodeTotals(std::size_t nodes);

  std::vector<double> slip;  // slip distance: integral of |sliding velocity| dt while the contact is closed  [m]
  // displacement of the soft metal against the hard metal over +-0.5 and +-1 mm (metal_bands.hpp) while the contact is
  // closed, positive along the tangent of the interface; 0 where a body is thinner  [m]
  std::vector<double> displacement_half_mm, displacement_one_mm;
  std::vector<double> friction_impulse;  // integral of the shear stress s dt  [Pa s]
  std::vector<double>
      critical_jump_share;               // largest |[V]| of a closed contact over the critical jump (shear_limits.hpp)
  std::vector<double> highest_pressure;  // [Pa]
  std::vector<double> fastest_slip;      // highest sliding velocity of a closed contact  [m/s]
  std::vector<double> pressure_impulse;  // integral of the pressure while the node slips  [Pa s]
  std::vector<double> slip_time;         // [s]
  std::vector<double> friction_work;     // integral of s [v]  [J/m2]
  std::vector<double> friction_time;     // time since friction began  [s]
  std::vector<double> highest_melting;   // highest melting temperature since friction began  [K]
  std::vector<double> bound_used;        // friction_work over HeatBound::work(), between 0 and 1
};

// The displacement of the nodes over band `band` of MetalBands::kDistances.
inline const std::vector<double>& displacement(const NodeTotals& totals, std::size_t band) {
  return band == 0 ? totals.displacement_half_mm : totals.displacement_one_mm;
}

// The history of the interface nodes, and the totals over nodes and steps that the summary prints.
class InterfaceHistory {
 public:
  explicit InterfaceHistory(const Problem2d& problem);

  void observe(const lagrange::Cycle& cycle);  // adds the last step to the totals
  void record(const lagrange::Cycle& cycle);   // adds a row to the history

  void save(files::DumpWriter& dump) const;
  void load(const files::DumpReader& dump);
  // `start_temperature`: of the layers, where it is not that of the scene, else empty  [K]
  void write(const std::filesystem::path& file, const std::map<std::string, std::string>& meta,
             const files::ProfileRecord& profiles, const std::vector<double>& start_temperature) const;

  std::size_t nodes() const { return totals_.slip.size(); }
  const NodeTotals& totals() const { return totals_; }
  bool has_bound() const { return bound_.has_value(); }
  bool has_critical_jump() const { return critical_jump_.has_value(); }
  std::size_t nodes_above_critical_jump() const;
  // All means are over the length of the interface, that of a displacement where both bodies reach as far as the band;
  // it is absent if they do so nowhere.
  double mean(const std::vector<double>& values) const { return line_.mean(values); }
  std::optional<double> mean_displacement(std::size_t band) const;
  double mean_friction_impulse() const { return mean(totals_.friction_impulse); }
  const std::vector<double>& lengths() const { return line_.lengths(); }  // each node's part of the interface  [m]
  double most_bound_used() const { return peaks_[kBoundUsed]; }           // of all nodes and times
  // Whether a node was in the regime of melting at a step so far.
  bool has_melted() const { return regimes_[static_cast<std::size_t>(wire::Regime::kMelting)] > 0.0; }
  double share(wire::Regime regime) const;          // share of all node-steps so far that were in this regime
  double share_of_slip(wire::Regime regime) const;  // share of the mean slip distance
  const files::EnergyTotals& energy() const { return energy_; }
  double hottest() const { return peaks_[kTemperature]; }
  double highest_pressure() const { return peaks_[kPressure]; }
  double longest_slip() const;
  double mean_slip() const { return mean(totals_.slip); }
  // Mean of P sqrt(t), with the mean pressure P of a node over the time t of its slip  [Pa s^(1/2)]
  double mean_pressure_root_time() const;

 private:
  enum Peak : std::size_t { kTemperature, kPressure, kBoundUsed };

  void use_bound(std::size_t i, double work, const InterfaceInputs& in);
  void add_displacement(const lagrange::Cycle& cycle, std::size_t i);

  InterfaceLine line_;
  std::optional<HeatBound> bound_;  // without one of these three nothing is said of it
  std::optional<MetalBands> bands_;
  std::optional<CriticalJump> critical_jump_;
  HistoryRows rows_;
  NodeTotals totals_;
  std::array<double, wire::kRegimeCount> regimes_{};  // number of node-steps in each regime
  std::array<double, wire::kRegimeCount>
      regime_slip_{};              // integral of the slip distance over the interface in each regime  [m2]
  std::array<double, 3> peaks_{};  // largest temperature [K], pressure [Pa] and share of the bound so far
  files::EnergyTotals energy_;
};

}  // namespace shearbus::hydro
