// What the summaries of one- and two-dimensional runs have in common.
#pragma once

#include <chrono>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {

inline double seconds(std::chrono::nanoseconds time) {
  return std::chrono::duration<double>(time).count();
}

// Times of a run. The times of output and of the law are part of the total.
struct RunTime {
  std::chrono::nanoseconds total{0};
  std::chrono::nanoseconds output{0};  // time spent writing results
  double cpu_s = 0.0;                  // CPU time of all threads of the process; in two dimensions only  [s]
  LawTime law;
  std::chrono::nanoseconds hydro() const { return total - law.solver - law.bus - output; }
  double share(std::chrono::nanoseconds part) const { return seconds(part) / seconds(total); }
};

nlohmann::ordered_json as_json(const files::EnergyTotals& energy);  // each energy as the mean over the nodes  [J/m2]
nlohmann::ordered_json as_json(const OmittedCost& omitted);
nlohmann::ordered_json as_json(const server::Entries& entries);

using SummaryLines = std::vector<std::pair<std::string, std::string>>;  // lines of a summary, each with label and text
// Returns the lines that explain the names of the regimes: what limits the friction in each of them.
SummaryLines regime_lines();

}  // namespace shearbus::hydro
