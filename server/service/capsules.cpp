// Failure capsules: small files, one for each node without an answer, with its state, inputs, scene and versions.
#include <fmt/format.h>

#include <exception>

#include "server/service/columns.hpp"
#include "server/service/member.hpp"
#include "server/service/service.hpp"

namespace shearbus::service {

namespace {

// The values of one row of the batch. Numbers of type uint8 become doubles; node ids are left out.
std::vector<store::CapsuleValue> values_of(const wire::Batch& batch, std::size_t row) {
  std::vector<store::CapsuleValue> values;
  for (const wire::Column& column : batch.columns()) {
    if (column.element == wire::Element::kFloat64)
      values.push_back({name_of(column), batch.f64(column.field, column.component)[row]});
    if (column.element == wire::Element::kUint8)
      values.push_back({name_of(column), static_cast<double>(batch.u8(column.field)[row])});
  }
  return values;
}

// The state of one node, without the columns that tell its pair: the scene of the capsule is that of the pair alone.
shard::States state_of(const shard::Shard& shard, std::uint32_t slot, bool of_trial) {
  shard::States state = shard.states_of(std::span(&slot, 1), of_trial);
  state.columns.resize(state.columns.size() - shard.pairs().columns().size());
  return state;
}

}  // namespace

// Writes a capsule for each node without an answer. Errors are logged only: the step is answered without a capsule.
void Service::leave_capsules(const Member& member, const RunningStep& running, bool from_trial) noexcept try {
  if (store_ == nullptr || replaying_) return;
  end_checkpoint(true);  // HDF5 is for one thread at a time
  const shard::Shard& shard = *member.shard;
  const wire::Downscale& step = running.step();
  const shard::Rows& rows = running.rows;
  const std::span<const std::uint8_t> outcomes = running.outcomes();
  for (std::size_t row = 0; row < outcomes.size(); ++row) {
    if ((outcomes[row] & wire::kFailed) == 0) continue;
    const std::uint64_t node = node_of(shard.nodes(), rows, running.request.batch, row);
    const std::uint32_t slot = slot_of(shard.nodes(), rows, row);
    const std::string file = store_->leave_capsule(
        {.server_version = options_.server_version,
         .session = member.id,
         .sequence = running.request.sequence,
         .scene = member.pairs.several() ? member.pairs.scene_of(shard.pairs()[shard.pair_of(slot)]) : member.scene,
         .node_id = node,
         .dt_s = step.dt_s,
         .time_s = step.time_s,
         .step = step.step,
         .attempt = step.attempt,
         .state = state_of(shard, slot, from_trial),
         .inputs = values_of(running.request.batch, row),
         .answer = values_of(running.reply->batch, row)});
    if (file.empty()) return;
    log(fmt::format("WARNING: node {} of session {} has no answer to step {}: {}", node, short_name(member.id),
                    step.step, file));
  }
} catch (const std::exception& fault) {
  log(std::string("ALARM: a failure capsule could not be written: ") + fault.what());
}

}  // namespace shearbus::service
