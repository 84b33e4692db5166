// A step in parts: one step of more rows than a message holds, divided over several requests.
#pragma once

#include <cstddef>
#include <vector>

#include "proto/wire/messages.hpp"
#include "server/shard/node_table.hpp"

namespace shearbus::service {

// The parts of a step that have come, while others are missing. Their rows are in the shard's trial.
struct Parts {
  wire::Downscale last;       // the last part that has come
  std::vector<bool> stepped;  // by slot: the nodes of the parts
  std::size_t nodes = 0;      // number of these nodes

  void add(const wire::Downscale& part, const shard::Rows& rows) noexcept;
};

// Refuses a part that is not the next one, that does not agree with the parts before it, or that names one of their
// nodes. `before` is null if no step in parts has begun. Throws wire::Error.
void check_part(const wire::Downscale& part, const wire::Batch& batch, const Parts* before);
void check_rows_of_part(const wire::Batch& batch, const shard::Rows& rows, const Parts& before);

// Refuses a part that follows another request than the last one of the session, whose header frame has the hash `last`.
// Such a part may be a late copy from a step that its client has given up.
void check_follows(const wire::Downscale& part, std::uint64_t last);

}  // namespace shearbus::service
