// Fields of a run for ParaView and VisIt: FIELDS.h5 with one group a frame, and FIELDS.xmf beside it that says how to
// read it (XDMF 3; opened by ParaView's Xdmf2 and Xdmf3 readers). Quadrilaterals in the plane z = 0. Layout in
// recording.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "proto/wire/recording.hpp"

namespace shearbus::wire {

class FieldWriter {
 public:
  // `quads` holds four nodes a zone; `file` ends in .h5. Both files have their names only when closed.
  FieldWriter(std::filesystem::path file, std::span<const std::int32_t> quads, std::size_t nodes,
              std::vector<Quantity> zone_quantities, std::string scene);
  FieldWriter(FieldWriter&&) noexcept;
  FieldWriter& operator=(FieldWriter&&) noexcept;
  ~FieldWriter();  // of a writer that was not closed: removes the partial file

  // Nodes' places and velocities as x, y, 0 for each; one span of zone values for each quantity, in their order.
  void frame(double time_s, std::span<const double> place, std::span<const double> velocity,
             std::span<const std::span<const double>> zones);
  void close();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace shearbus::wire
