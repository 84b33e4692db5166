// The summary of a one-dimensional run. It is collected in each step, printed at the end and written as summary.json.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "hydro_stub/problem.hpp"
#include "hydro_stub/shear_column.hpp"
#include "hydro_stub/summary_json.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {

class Summary {
 public:
  Summary(const ColumnProblem& problem, std::string interface_law, server::Entries provenance);

  void observe(const ShearColumn& column);
  void finish(const ShearColumn& column, const RunTime& time);
  // Sets the optional physics that the scene left switched off; its memory is known only after InterfaceLaw::close().
  void omitted(OmittedCost omitted) { omitted_ = std::move(omitted); }

  std::string text() const;
  std::string json() const;

 private:
  // The largest interface temperature so far [K], with its node and time [s].
  struct Peak {
    std::size_t node = 0;
    double time = 0.0;
    double value = 0.0;
  };

  const ColumnProblem& problem_;
  std::string interface_law_;
  server::Entries provenance_;
  std::uint64_t steps_ = 0;
  double end_time_ = 0.0;

  double melting_threshold(double pressure) const;  // [K]
  // Free slip has the regime code of Coulomb friction, with a limit of 0, and a name of its own.
  bool slips_freely() const { return interface_law_ == "free_slip"; }
  double heat_partition() const;
  double heat_into_soft() const;  // sum over nodes; where both bodies conduct, as the ledger tells it  [J/m2]

  Peak peak_;
  // first time at which the interface temperature of each node reached melting_threshold(); negative: not reached  [s]
  std::vector<double> melting_time_;
  std::vector<double> slip_;  // slip distance of each node, the integral of |sliding velocity| dt  [m]
  // Displacement of the soft against the hard metal over +-kBands of the interface, per column; empty where a body is
  // shorter  [m]
  static constexpr std::array<double, 3> kBands = {0.1e-3, 0.5e-3, 1e-3};  // [m]
  struct Band {
    std::optional<std::pair<BodyPlace, BodyPlace>> places;  // in the soft and in the hard body
    std::vector<double> displacement;
  };
  std::array<Band, kBands.size()> bands_;
  std::vector<double> friction_impulse_;  // integral of s dt of each column  [Pa s]
  std::array<std::uint64_t, wire::kRegimeCount> regime_count_{};
  double heat_ = 0.0;  // friction heat that entered the bodies that conduct, sum over nodes  [J/m2]
  files::EnergyTotals energy_;
  OmittedCost omitted_;
  std::uint64_t flagged_ = 0;

  double friction_work_ = 0.0;   // of the stress on the slip, sum over nodes  [J/m2]
  double interface_work_ = 0.0;  // of the stress on the mean jump, which the bodies give, sum over nodes  [J/m2]
  // largest residual of a node's momentum balance, relative to the sum of the magnitudes in this balance
  double momentum_residual_ = 0.0;
  // largest residual of a node's energy balance, relative to the sum of the magnitudes in this balance
  double energy_residual_ = 0.0;
  RunTime time_;
};

}  // namespace shearbus::hydro
