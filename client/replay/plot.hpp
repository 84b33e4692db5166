// shearbus-replay plot: draws a history with plot_history.py.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace shearbus::replay {

struct PlotOptions {
  std::vector<std::filesystem::path> files;  // HDF5 files of the same steps, or one event log
  std::filesystem::path out;                 // a PNG file
  std::optional<std::uint64_t> node;         // none: the hottest
};

// Throws Error, or Told where Python has told why the picture is not drawn.
void plot(const PlotOptions& options);

}  // namespace shearbus::replay
