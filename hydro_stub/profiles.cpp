#include "hydro_stub/profiles.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "hydro_stub/problem.hpp"
#include "hydro_stub/scene.hpp"

namespace shearbus::hydro {

files::ProfileRecord profile_record(const guest::HydroScene& scene, std::size_t nodes, InterfaceLaw& law) {
  const guest::Profiles& asked = scene.hydro().profiles();
  std::vector<std::uint64_t> ids;
  for (const double node : asked.node()) {
    if (node != std::floor(node) || !(node < static_cast<double>(nodes)))
      refuse("hydro.profiles.node", fmt::format("node {:g}, expected a whole number below {}", node, nodes),
             "name interface nodes of this problem, which are numbered from 0");
    ids.push_back(static_cast<std::uint64_t>(node));
  }
  if (!ids.empty()) {
    if (scene.hydro().interface_law() != guest::INTERFACE_LAW_SUBGRID)
      refuse("hydro.profiles", fmt::format("the law {} has no layers", name(scene.hydro().interface_law())),
             "leave out [hydro.profiles], or set interface_law = \"subgrid\"");
    law.profiles(ids, {});
  }
  files::ProfileRecord record(std::move(ids), {asked.time_s().begin(), asked.time_s().end()});
  if (record.last_s() > scene.hydro().end_time_s())
    refuse("hydro.profiles.time_s",
           fmt::format("time {:.6g} s, expected times up to hydro.end_time_s = {:.6g} s", record.last_s(),
                       scene.hydro().end_time_s()),
           "leave out later times, or end the run later");
  return record;
}

void record_profiles(files::ProfileRecord& record, double time_s, std::span<const double> pressure, InterfaceLaw& law) {
  if (!record.due(time_s)) return;
  std::vector<double> of_nodes;
  for (const std::uint64_t node : record.node_ids()) of_nodes.push_back(pressure[node]);
  record.add(time_s, law.profiles(record.node_ids(), of_nodes), of_nodes);
}

}  // namespace shearbus::hydro
