#include "client/replay/capsule.hpp"

#include <fmt/format.h>

#include "proto/files/input_file.hpp"
#include "proto/program/program.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"
#include "server/capsule_replay.hpp"

namespace shearbus::replay {

bool run_capsule(const std::filesystem::path& file) {
  const files::RegularFile regular(file);  // a pipe is refused, which would keep the program waiting
  const server::CapsuleReplay capsule = server::replay_capsule(file);
  fmt::print("{}: node {}, step {} (attempt {}) of {} s to {} s, by server {}\n", program::shown(file), capsule.node_id,
             capsule.step, capsule.attempt, capsule.dt_s, capsule.time_s,
             wire::printable(capsule.server_version, wire::kMaxNameBytes));
  fmt::print("  started from\n");
  for (const auto& part : capsule.state)
    fmt::print("    {:<22} {} values, {} to {} {}{}\n", part.name, part.values, part.lowest, part.highest, part.units,
               part.not_finite == 0 ? "" : fmt::format(", {} NOT FINITE", part.not_finite));
  fmt::print("  host said\n");
  for (const auto& [name, value] : capsule.inputs) fmt::print("    {:<30} {}\n", name, value);
  fmt::print("  answer                             recorded                  now\n");
  for (const auto& column : capsule.answer)
    fmt::print("    {:<30} {:<25} {:<25} {}\n", column.name, column.recorded, column.found,
               column.same ? "same bits" : "DIFFERS");
  fmt::print("{}\n", capsule.same() ? "the same answer, to the last bit" : "ANOTHER ANSWER than was recorded");
  return capsule.same();
}

}  // namespace shearbus::replay
