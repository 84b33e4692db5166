// Writes history.h5 of a run: the inputs and the answers of the interface law in each step, so that shearbus-replay can
// repeat the run. proto/files/recording.md describes the layout of the file.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "hydro_stub/problem.hpp"
#include "hydro_stub/shear_column.hpp"
#include "proto/files/profile_record.hpp"
#include "proto/files/recording.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {

class History {
 public:
  History(const std::filesystem::path& file, const ColumnProblem& problem, const ShearColumn& column,
          const std::map<std::string, std::string>& meta);

  void record(const ShearColumn& column);
  void close(const files::ProfileRecord& profiles) {
    profiles.write(writer_);
    writer_.close();
  }

 private:
  files::HistoryWriter writer_;
};

// Returns what /meta says of a result: its scene, with all constants filled in, its interface law, and its origin.
std::map<std::string, std::string> meta_of(const guest::HydroScene& effective, const server::Entries& provenance);

// Returns the node ids of the columns in sessions and histories: 0, 1, 2, ...
std::vector<std::uint64_t> node_ids(std::size_t columns);

}  // namespace shearbus::hydro
