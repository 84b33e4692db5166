// The interface nodes along their slide lines, and means over the length of the interface: values are linear between
// nodes, so that a node at an end of the interface, or of a window of it, stands for half as much as one inside.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "hydro_stub/lagrange/cycle.hpp"

namespace shearbus::hydro {

class InterfaceLine {
 public:
  explicit InterfaceLine(const lagrange::Bodies& bodies);

  // The part of the interface that belongs to each node: half of each segment that ends there, at the start  [m]
  const std::vector<double>& lengths() const { return lengths_; }

  // Returns the mean of values, one per node, over the length of the interface.
  double mean(const std::vector<double>& values) const;
  // Returns the mean over the segments whose two nodes are in the window; over its nodes if it has no segment; nothing
  // if it has no node.
  std::optional<double> mean(const std::vector<double>& values,
                             const std::function<bool(std::size_t)>& in_window) const;

 private:
  struct Segment {
    std::size_t from, to;  // interface nodes
    double length;         // [m]
  };
  std::vector<Segment> segments_;
  std::vector<double> lengths_;
};

}  // namespace shearbus::hydro
