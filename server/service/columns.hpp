// The columns of a session's steps: which columns a model has, and which tile member belongs to each column of a
// request and of its reply. A shard moves the values between columns and tiles.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "proto/wire/batch.hpp"
#include "proto/wire/columns.hpp"
#include "proto/wire/status.hpp"
#include "server/shard/shard.hpp"

namespace shearbus::service {

// The node in a row of a step, and the slot of its state.
inline std::uint64_t node_of(const shard::NodeTable& nodes, const shard::Rows& rows, const wire::Batch& batch,
                             std::size_t row) {
  return rows.all ? nodes.ids()[row] : batch.u64(wire::Field::kNodeId)[row];
}
inline std::uint32_t slot_of(const shard::NodeTable& nodes, const shard::Rows& rows, std::size_t row) {
  return rows.all ? nodes.slot_of(row) : rows.slots[row];
}

// The name of a column in a capsule: its field's name, with an ending for the second tangential component.
std::string name_of(const wire::Column& column);

wire::Strategy strategy_of(const physics::ModelOptions& options);

// The condition under which a session has a column of its strategy, and the refusal if it lacks the column.
struct ColumnCondition {
  wire::Field field;  // the column that the condition is about; kUnspecified: all columns of the energy ledger
  bool (*holds)(const shard::Shard&, const physics::ModelOptions&);  // true if a session with this shard has the column
  wire::Code code;
  const char* fault;  // fault text that follows the column's name
  const char* remedy;
};
// The condition of this column that the session does not meet. Null if it has the column, or if none of its strategy has.
const ColumnCondition* unmet_condition(wire::Field field, const shard::Shard& shard);

// Those of the columns whose conditions the session meets.
std::vector<wire::Field> columns_met(std::span<const wire::Field> columns, const shard::Shard& shard);

// The columns that the request holds and the columns that the reply has room for. The batches must outlive the result.
// If the request gives the stick stress and the impedance of each node instead of the stresses and masses of the two
// bodies, these are converted to stresses and masses with the same momentum balance over the step length `dt` [s].
// `memory`: columns of an earlier step, whose memory is used.
shard::StepColumns step_columns(const wire::Batch& request, wire::Batch& reply, double dt,
                                shard::StepColumns memory = {});

}  // namespace shearbus::service
