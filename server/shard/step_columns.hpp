// The columns of a step. Each input column fills a member of a tile, each answer column is filled from a member. The
// shard only copies values and need not know which quantities they are.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <variant>
#include <vector>

#include "server/physics/solver/tile.hpp"

namespace shearbus::shard {

// A column of a request with one value per row. A tile member for which the request has no column is 0.
struct InputColumn {
  double (physics::TileInputs::*member)[physics::kLanes];
  std::span<const double> values;
};

// Answers of one step of one tile: those of the model, and the sums that the shard keeps of them.
struct TileAnswers : physics::TileOutputs {
  alignas(64) double friction_energy_soft[physics::kLanes];  // only where the shard sums the energy  [J/m2]
  alignas(64) double friction_energy_hard[physics::kLanes];
};

// A column of the reply, filled from a tile member with one value per row.
template <typename Lane, typename Value>
struct AnswerColumn {
  Lane (TileAnswers::*member)[physics::kLanes];
  std::span<Value> values;
};
template <typename Lane, typename Value>
AnswerColumn(Lane (physics::TileOutputs::*)[physics::kLanes], std::span<Value>) -> AnswerColumn<Lane, Value>;
struct LedgerColumn {
  physics::LedgerTerm term;
  std::span<double> values;
};
using OutputColumn = std::variant<AnswerColumn<double, double>, AnswerColumn<physics::Regime, std::uint8_t>,
                                  AnswerColumn<std::uint8_t, std::uint8_t>, LedgerColumn>;

struct StepColumns {
  std::vector<InputColumn> inputs;
  std::vector<double> converted;  // values of input columns that were converted from the request's stick form
  std::vector<OutputColumn> outputs;
  std::span<double> closure[2];  // receives, for each component, sent minus answered jump  [m/s]; empty: not wanted
  // Whether columns of the reply hold the mean stress of the step, derivatives of the stress, the time to melting.
  bool wants_mean_stress = false;
  bool wants_tangent = false;
  bool wants_time_to_melting = false;
  double host_time = 0.0;  // host's time at the end of the step, 0: not given  [s]

  bool has_ledger() const {
    return std::ranges::any_of(outputs,
                               [](const OutputColumn& column) { return std::holds_alternative<LedgerColumn>(column); });
  }
};

}  // namespace shearbus::shard
