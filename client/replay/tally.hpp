// Totals of a replay for its printed summary.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/replay/bus.hpp"
#include "proto/files/energy_totals.hpp"

namespace shearbus::replay {

struct RunTime {
  std::chrono::nanoseconds reading{0};
  std::chrono::nanoseconds bus{0};  // time of round trips minus time of the solver
  std::chrono::nanoseconds solver{0};
  std::chrono::nanoseconds writing{0};
  std::chrono::nanoseconds total{0};
};

// The lowest and the highest of some values.
struct Range {
  double lowest = std::numeric_limits<double>::infinity(), highest = -std::numeric_limits<double>::infinity();
  void add(std::span<const double> values);
  std::string text(const char* unit) const;
};

// The ranges of the inputs of a replay.
struct InputRanges {
  Range pressure, jump, dt;
  void add(const Batch& request, double dt_s);
  std::string text() const;  // a line of the summary
};

class Tally {
 public:
  explicit Tally(const std::vector<std::uint64_t>& node_ids);

  void add(const Batch& request, const Answer& answer, double time_s, double dt_s);

  const std::vector<double>& peaks_k() const { return peaks_k_; }  // highest temperature of each node
  std::uint64_t failed_node_steps() const { return outcomes_[kFailedBit]; }
  std::string text(const RunTime& time) const;                              // lines of the summary, indented
  void add_to(nlohmann::ordered_json& summary, const RunTime& time) const;  // the same numbers in SI units

 private:
  static constexpr std::size_t kFailedBit = 7;
  std::string regimes_text() const;
  std::string outcomes_text() const;

  const std::vector<std::uint64_t>& node_ids_;
  InputRanges inputs_;
  std::vector<double> slip_;  // path length of the slip of each node  [m]
  std::vector<double> peaks_k_;
  std::vector<double> heat_;  // friction heat of each node  [J/m2]
  std::array<std::uint64_t, wire::kRegimeCount> regimes_{};
  std::array<std::uint64_t, 8> outcomes_{};  // number of node-steps with each outcome bit
  std::uint64_t node_steps_ = 0;
  std::uint64_t flagged_ = 0;
  double peak_temperature_k_ = -std::numeric_limits<double>::infinity();
  double peak_time_s_ = 0.0;
  std::size_t peak_node_ = 0;
  files::EnergyTotals energy_;
  std::optional<double> first_melting_s_;
  std::size_t first_melting_node_ = 0;
};

}  // namespace shearbus::replay
