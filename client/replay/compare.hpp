// shearbus-replay compare A B: the first place where two recordings or results differ.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "proto/wire/messages.hpp"

namespace shearbus::replay {

// The first difference of two batches of the same rows, by column and node: "shear_stress of node 7 is 1.5e8 in A,
// 1.6e8 in B (3 of 24 values of the step differ)". Numbers are equal if their bits are, or within `rtol` of the larger
// one.
struct Names {
  std::string a, b;
};
std::optional<std::string> difference(const wire::Batch& a, const wire::Batch& b, std::span<const std::uint64_t> rows,
                                      const Names& names, double rtol);

// The first difference of two replies to the same request, without times of computing and texts.
std::optional<std::string> difference(const wire::Reply& a, const wire::Reply& b, std::span<const std::uint64_t> rows,
                                      const Names& names, double rtol);

// The place of a request in a log: "step 12 (request 13, ends at 1.3e-08 s)".
std::string place_of(const wire::Request& request, std::uint64_t steps);

// Compares two event logs, or two tables, and prints what is found. Returns whether they are equal.
bool compare(const std::filesystem::path& a, const std::filesystem::path& b, double rtol);

}  // namespace shearbus::replay
