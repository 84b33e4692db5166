// Histories of a two-dimensional run: the interface nodes and a free surface.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "hydro_stub/history_rows.hpp"
#include "hydro_stub/lagrange/cycle.hpp"
#include "proto/wire/energy_totals.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::hydro {

// The history of the interface nodes, and the totals over nodes and steps that the summary prints.
class InterfaceHistory {
 public:
  explicit InterfaceHistory(std::size_t nodes);

  void observe(const lagrange::Cycle& cycle);  // adds the last step to the totals
  void record(const lagrange::Cycle& cycle);   // adds a row to the history

  void save(wire::DumpWriter& dump) const;
  void load(const wire::DumpReader& dump);
  void write(const std::filesystem::path& file, const std::map<std::string, std::string>& meta) const;

  std::size_t nodes() const { return slip_.size(); }
  double share(wire::Regime regime) const;  // share of all node-steps so far that were in this regime
  const wire::EnergyTotals& energy() const { return energy_; }
  double hottest() const { return peaks_[kTemperature]; }
  double highest_pressure() const { return peaks_[kPressure]; }
  double longest_slip() const;
  double mean_slip() const;

 private:
  enum Peak : std::size_t { kTemperature, kPressure };

  HistoryRows rows_;
  // slip distance of each node: integral of |sliding velocity| dt while the contact is closed  [m]
  std::vector<double> slip_;
  std::array<double, 5> regimes_{};  // number of node-steps in each regime
  std::array<double, 2> peaks_{};    // largest temperature [K] and pressure [Pa] so far
  wire::EnergyTotals energy_;
};

// The history of the nodes of a free surface, in their order along the surface.
class SurfaceHistory {
 public:
  explicit SurfaceHistory(std::vector<int> nodes);

  void record(const lagrange::Cycle& cycle);
  void save(wire::DumpWriter& dump) const { rows_.save(dump, "free_surface"); }
  void load(const wire::DumpReader& dump) { rows_.load(dump, "free_surface"); }
  void write(const std::filesystem::path& file, const std::map<std::string, std::string>& meta) const {
    rows_.write(file, meta);
  }
  bool empty() const { return nodes_.empty(); }

 private:
  std::vector<int> nodes_;
  HistoryRows rows_;
};

}  // namespace shearbus::hydro
