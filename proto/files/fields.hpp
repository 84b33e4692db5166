// Fields of a run for ParaView and VisIt. FIELDS.xmf describes the HDF5 files in the directory FIELDS, one file for
// each frame (XDMF 3; opened by ParaView's Xdmf2 and Xdmf3 readers). The zones are quadrilaterals in the plane z = 0.
// recording.md describes the layout.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "proto/files/recording.hpp"

namespace shearbus::files {

// Removes the mesh and all frames in the directory of a sidecar, then the sidecar. Files of other names stay.
void remove_fields(const std::filesystem::path& sidecar);

// frame() returns when the frame is on the disk and the sidecar names it, so the files of an interrupted run can be
// opened.
class FieldWriter {
 public:
  // `quads` holds four nodes per zone; `sidecar` ends in .xmf. `times_s` are the times of the frames of an earlier
  // process whose run continues; if there are none, existing frames are removed.
  FieldWriter(std::filesystem::path sidecar, std::span<const std::int32_t> quads, std::size_t nodes,
              std::vector<Quantity> zone_quantities, const std::string& scene, std::vector<double> times_s = {});

  // Writes a frame: positions and velocities of the nodes as x, y, 0, and one span of zone values for each quantity, in
  // the order of the quantities.
  void frame(double time_s, std::span<const double> place, std::span<const double> velocity,
             std::span<const std::span<const double>> zones);
  const std::vector<double>& times_s() const { return times_s_; }  // times of the written frames

 private:
  std::string item(const std::string& file, const char* dataset, const std::string& shape, const char* type,
                   int precision) const;
  std::string xdmf() const;

  std::filesystem::path sidecar_;
  std::filesystem::path directory_;
  std::size_t nodes_;
  std::size_t zones_;
  std::vector<Quantity> quantities_;
  std::vector<double> times_s_;
};

}  // namespace shearbus::files
