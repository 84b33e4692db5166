// The interface of a fuzz target: one input of any bytes. libFuzzer drives it (-DSHEARBUS_FUZZ=ON, clang); elsewhere
// replay.cpp passes it the committed corpus and mutations of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned int seed);
// Implemented by the driver.
extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

namespace shearbus::fuzz {

// Requires a property that holds for every input; a violation is a finding, as a crash is.
inline void require(bool holds, const std::string& law) {
  if (holds) return;
  std::fprintf(stderr, "BROKEN: %s\n", law.c_str());
  std::abort();
}

}  // namespace shearbus::fuzz
