// The columns of a session's steps: as a shard moves them.
#pragma once

#include <string>

#include "proto/wire/batch.hpp"
#include "proto/wire/columns.hpp"
#include "server/shard/step_columns.hpp"

namespace shearbus::service {

// The name of a column in a capsule: its field's name, with an ending for the second tangential component.
std::string name_of(const wire::Column& column);

// The columns that a request holds and a reply has room for. The batches must outlive them.
shard::StepColumns step_columns(const wire::Batch& request, wire::Batch& reply);

}  // namespace shearbus::service
