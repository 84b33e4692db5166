#include "server/service/parts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <string>
#include <utility>

#include "proto/wire/status.hpp"
#include "server/service/validate.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Downscale;

namespace {

bool same(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

[[noreturn]] void refuse_part(const char* field, std::string text) {
  refuse(Code::kInvalidValue, std::string("downscale.") + field, std::move(text),
         "Nothing was changed: the parts before stand. Send the next part, or begin the step again.");
}

// Name of the first field in which the parts do not agree; null if they agree.
const char* difference(const Downscale& a, const Downscale& b) {
  const auto accepts = [](wire::Policy policy) { return policy != wire::Policy::kAllOrNothing; };
  if (a.parts != b.parts) return "parts";
  if (!same(a.dt_s, b.dt_s)) return "dt_s";
  if (!same(a.time_s, b.time_s)) return "time_s";
  if (a.step != b.step) return "step";
  if (a.attempt != b.attempt) return "attempt";
  if (a.mode != b.mode) return "mode";
  if (accepts(a.policy) != accepts(b.policy)) return "policy";
  if (a.absent_nodes != b.absent_nodes) return "absent_nodes";
  return nullptr;
}

}  // namespace

void check_part(const Downscale& part, const wire::Batch& batch, const Parts* before) {
  if (part.part == 0 && part.parts == 0) return;
  if (part.part == 0 || part.part > part.parts)
    refuse_part("part", fmt::format("part {} of {}; expected 1 to the number of parts", part.part, part.parts));
  if (!batch.has(wire::Field::kNodeId))
    refuse(Code::kShape, wire::name(wire::Field::kNodeId),
           fmt::format("part {} of {} has no column node_id", part.part, part.parts), "Name the nodes of each part.");
  if (part.part == 1) return;
  if (part.commit_previous)
    refuse_part("commit_previous",
                fmt::format("commit_previous is set in part {}; only part 1 may have it", part.part));
  if (before == nullptr)
    refuse_part("part", fmt::format("part {} of {}, and no step in parts has begun", part.part, part.parts));
  if (part.part != before->last.part + 1)
    refuse_part("part", fmt::format("part {} of {}; expected part {}", part.part, part.parts, before->last.part + 1));
  if (const char* field = difference(part, before->last))
    refuse_part(field,
                fmt::format("{} of part {} is another than that of part {}", field, part.part, before->last.part));
}

void check_follows(const Downscale& part, std::uint64_t last) {
  if (part.part < 2)
    refuse_part("follows",
                fmt::format("follows is set in part {} of {}; only a later part may have it", part.part, part.parts));
  if (part.follows == last) return;
  refuse(Code::kSequenceGap, "downscale.follows",
         fmt::format("part {} follows a request whose header has XXH3-64 {:016x}; that of the last request "
                     "has {:016x}",
                     part.part, part.follows, last),
         "Nothing was changed. Wait for the answer to the part before, then send this one.");
}

void check_rows_of_part(const wire::Batch& batch, const shard::Rows& rows, const Parts& before) {
  const auto ids = batch.u64(wire::Field::kNodeId);
  check_rows(
      Code::kDuplicateNode, wire::name(wire::Field::kNodeId), std::span<const std::uint32_t>(rows.slots),
      [&](std::size_t, std::uint32_t slot) { return !before.stepped[slot]; }, [&](std::size_t row) { return ids[row]; },
      [](std::uint64_t node, std::size_t, std::uint32_t) {
        return fmt::format("node {} is in an earlier part of the step", node);
      },
      "Name each node in one part.");
}

void Parts::add(const Downscale& part, const shard::Rows& rows) noexcept {
  last.part = part.part;
  for (const std::uint32_t slot : rows.slots) stepped[slot] = true;
  nodes += rows.slots.size();
}

}  // namespace shearbus::service
