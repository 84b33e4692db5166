// Fields of a run for ParaView and VisIt: FIELDS.xmf says how to read the HDF5 files below FIELDS/, one for each frame
// (XDMF 3; opened by ParaView's Xdmf2 and Xdmf3 readers). Quadrilaterals in the plane z = 0. Layout in recording.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "proto/wire/recording.hpp"

namespace shearbus::wire {

// Every frame is on the disk, and the sidecar names it, when frame() returns: what a run that dies leaves can be
// opened.
class FieldWriter {
 public:
  // `quads` holds four nodes a zone; `sidecar` ends in .xmf. `times_s`: of frames that an earlier process left and this
  // one goes on from; none: what is there is removed.
  FieldWriter(std::filesystem::path sidecar, std::span<const std::int32_t> quads, std::size_t nodes,
              std::vector<Quantity> zone_quantities, const std::string& scene, std::vector<double> times_s = {});
  FieldWriter(FieldWriter&&) noexcept;
  FieldWriter& operator=(FieldWriter&&) noexcept;
  ~FieldWriter();

  // Nodes' places and velocities as x, y, 0 for each; one span of zone values for each quantity, in their order.
  void frame(double time_s, std::span<const double> place, std::span<const double> velocity,
             std::span<const std::span<const double>> zones);
  const std::vector<double>& times_s() const;  // of the frames so far

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::wire
