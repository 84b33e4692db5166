// The interface of a fuzz target: a function that takes any bytes as input. With clang and -DSHEARBUS_FUZZ=ON libFuzzer
// calls this function; otherwise replay.cpp calls it with the committed corpus and with mutations of the corpus.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned int seed);
// Mutates raw bytes. libFuzzer or replay.cpp implements this function.
extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

namespace shearbus::fuzz {

// Requires a property that must hold for every input. A violation ends the program, so the fuzzer reports it as a
// crash.
inline void require(bool holds, const std::string& law) {
  if (holds) return;
  std::fprintf(stderr, "BROKEN: %s\n", law.c_str());
  std::abort();
}

}  // namespace shearbus::fuzz
