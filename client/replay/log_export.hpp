// shearbus-replay export LOG: the committed steps of an event log as a table of steps and nodes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace shearbus::replay {

struct ExportOptions {
  std::filesystem::path log;
  std::filesystem::path out;              // HDF5, or CSV if it ends in .csv or .tsv
  std::optional<std::uint64_t> node;      // the steps of this node alone
  std::optional<std::string> after_mark;  // only the steps after the mark was last set
  std::string changes = {};               // of the scene since the recording, for /meta; empty: none
  std::filesystem::path final_name = {};  // tells HDF5 or CSV in place of `out`, which is renamed to it later; or empty

  const std::filesystem::path& like() const { return final_name.empty() ? out : final_name; }
};

// Writes the steps that lead to the session's last state: trials that were rolled back and steps before a rollback to a
// mark are left out. Returns the number of steps. Throws Error if the nodes change and no node was chosen.
std::size_t export_log(const ExportOptions& options);

}  // namespace shearbus::replay
