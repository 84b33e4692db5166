// What a run leaves in HISTORY.h5: the answers, and beside them what was sent, so that shearbus-replay can send it
// again. The layout is in proto/wire/recording.md.
#pragma once

#include <filesystem>
#include <string>

#include "hydro_stub/problem.hpp"
#include "hydro_stub/shear_column.hpp"
#include "proto/wire/recording.hpp"

namespace shearbus::hydro {

class History {
 public:
  // `scene` is the effective scene as TOML, `law` what the results are of.
  History(const std::filesystem::path& file, const Problem& problem, const ShearColumn& column,
          const std::string& scene, const std::string& law);

  void record(const ShearColumn& column);
  void close() { writer_.close(); }

 private:
  wire::HistoryWriter writer_;
};

// 0, 1, 2, ...: the columns as nodes of a session and of a history.
std::vector<std::uint64_t> node_ids(std::size_t columns);

}  // namespace shearbus::hydro
