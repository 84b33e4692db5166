// The profiles of nodes across the layer, read from their committed states.
#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "proto/wire/text.hpp"
#include "server/service/member.hpp"
#include "server/service/service.hpp"
#include "server/service/validate.hpp"

namespace shearbus::service {

using wire::Code;
using wire::Field;

namespace {

std::vector<Field> profile_columns(const physics::TileLayout& layout) {
  std::vector<Field> fields = {Field::kNodeId, Field::kPosition, Field::kWidth, Field::kLayerTemperature};
  if (layout.num_strain_vertices > 0)
    fields.insert(fields.end(), {Field::kLayerPlasticStrain, Field::kLayerFlowStress});
  fields.push_back(Field::kLayerShearStress);
  return fields;
}

constexpr std::uint64_t kBytesPerVertex = 64;  // what it takes to read one, as memory that takes as long to write

// Reads the profiles of the nodes in `rows`, which `asked` names, into a batch.
void profiles_of(const wire::Batch& asked, const shard::Rows& rows, const shard::Shard& shard, wire::Batch& made) {
  const physics::Model& model = shard.model();
  physics::ProfileGrid grid = model.profile_grid();
  const physics::Model* of_grid = &model;
  const std::size_t vertices = grid.position.size();
  const auto ids = asked.u64(Field::kNodeId);
  const auto pressures = asked.f64(Field::kPressure);
  const auto components = static_cast<std::uint32_t>(model.options().tangential_components);
  wire::Batch batch = wire::Batch::of(profile_columns(model.layout()), rows.slots.size() * vertices, components);
  const std::span<std::uint64_t> id_of_row = batch.u64(Field::kNodeId);
  for (std::size_t node = 0; node < rows.slots.size(); ++node) {
    const std::size_t first = node * vertices;
    const auto rows_of = [&](Field field, std::uint32_t component = 0) {
      const std::span<double> column = batch.f64(field, component);
      return column.empty() ? nullptr : column.data() + first;
    };
    std::fill_n(id_of_row.begin() + static_cast<std::ptrdiff_t>(first), vertices, ids[node]);
    const physics::Model& of_node = shard.model_of(rows.slots[node]);
    if (&of_node != of_grid) grid = of_node.profile_grid();
    of_grid = &of_node;
    std::ranges::copy(grid.position, rows_of(Field::kPosition));
    std::ranges::copy(grid.width, rows_of(Field::kWidth));
    of_node.profile(shard.committed_tile(rows.slots[node]).data(), static_cast<int>(rows.slots[node] % physics::kLanes),
                    pressures.empty() ? 0.0 : pressures[node],
                    {.temperature = rows_of(Field::kLayerTemperature),
                     .plastic_strain = rows_of(Field::kLayerPlasticStrain),
                     .flow_stress = rows_of(Field::kLayerFlowStress),
                     .shear_stress = rows_of(Field::kLayerShearStress),
                     .second_shear_stress = rows_of(Field::kLayerShearStress, 1)});
  }
  made = std::move(batch);
}

}  // namespace

Service::ReplyPtr Service::read_profiles(const wire::ReadProfiles& /*asked*/, Arrival& arrival, const ReplyPtr& reply) {
  const wire::Request& request = arrival.request;
  Member& member = open_member(request.session_id);
  check_identity(member, arrival.caller);
  member.last_request_ns = arrival.started_ns;
  check_epoch(request, &member);
  if (must_wait(member)) return reply;
  hold(member);
  const shard::Shard& shard = *member.shard;
  const physics::Model& model = shard.model();
  if (!model.keeps_profile())
    refuse(Code::kUnsupported, "layer.heat",
           "the nodes of this scene keep no profile: layer.heat is \"modes\", a sum of exponentials that "
           "gives the interface temperature alone",
           "Open the session with layer.heat = \"profile\", and with cells and grading in place of a "
           "tolerance.");
  const shard::Rows rows = check_profile_nodes(request.batch, shard.nodes());
  const std::size_t vertices = model.profile_grid().position.size();
  if (const std::size_t most = wire::kMaxRowsPerMessage / vertices; rows.slots.size() > most)
    refuse(Code::kLimit, wire::name(Field::kNodeId),
           fmt::format("profiles of {} with {} vertices each; a message has at most {} rows",
                       wire::counted(rows.slots.size(), "node"), vertices, wire::kMaxRowsPerMessage),
           fmt::format("Ask for at most {} at once.", wire::counted(most, "node")));
  aside(rows.slots.size() * vertices * kBytesPerVertex, [&] { profiles_of(request.batch, rows, shard, reply->batch); });
  reply->body =
      wire::Profiles{.nodes = rows.slots.size(), .vertices = vertices, .state_version = shard.state_version()};
  return reply;
}

}  // namespace shearbus::service
