// The columns that a step of a session needs.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "client/src/session.hpp"
#include "proto/wire/columns.hpp"

namespace shearbus::support {

// Returns zeroed columns of a step of all nodes, or of those that are named.
inline Batch step_request(const Session& session, Form form = Form::kFarField,
                          std::span<const std::uint64_t> named = {}) {
  std::vector<Field> fields = wire::columns_in(form, session.opened.required_columns);
  if (!named.empty()) fields.insert(fields.begin(), Field::kNodeId);
  Batch batch =
      Batch::of(fields, named.empty() ? session.node_ids.size() : named.size(), session.opened.tangential_components);
  std::ranges::copy(named, batch.u64(Field::kNodeId).begin());
  return batch;
}

}  // namespace shearbus::support
