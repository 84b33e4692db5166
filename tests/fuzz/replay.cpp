// A driver for machines without libFuzzer. It runs a target on every file of its corpus and on mutations of these
// files; every run makes the same mutations. Usage:
//   shearbus-fuzz-TARGET DIRECTORY [MUTATIONS OF EACH]
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "tests/fuzz/target.hpp"

namespace {

constexpr std::size_t kLongest = std::size_t{1} << 16;
std::mt19937 random_bytes;  // NOLINT(cert-msc51-cpp): fixed seed, for the same mutations in every run

}  // namespace

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size) {
  std::string bytes(reinterpret_cast<const char*>(data), size);
  const auto place = [&] { return bytes.empty() ? 0 : random_bytes() % bytes.size(); };
  switch (random_bytes() % 4) {
    case 0:
      bytes.insert(place(), 1, static_cast<char>(random_bytes()));
      break;
    case 1:
      bytes.erase(place(), 1 + random_bytes() % 8);
      break;
    default:
      if (!bytes.empty()) bytes[place()] ^= static_cast<char>(1U << (random_bytes() % 8));
  }
  bytes.resize(std::min(bytes.size(), max_size));
  std::copy(bytes.begin(), bytes.end(), data);
  return bytes.size();
}

int main(int argc, char** argv) {
  if (argc < 2) {
    std::cerr << "usage: " << argv[0] << " DIRECTORY [MUTATIONS OF EACH]\n";
    return 2;
  }
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(argv[1])) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  const unsigned mutations = argc > 2 ? static_cast<unsigned>(std::stoul(argv[2])) : 0;
  std::size_t inputs = 0;
  for (const auto& file : files) {
    std::ifstream stream(file, std::ios::binary);
    const std::vector<char> bytes{std::istreambuf_iterator<char>(stream), {}};
    std::vector<std::uint8_t> input(bytes.begin(), bytes.end());
    LLVMFuzzerTestOneInput(input.data(), input.size());
    for (unsigned i = 0; i < mutations; ++i) {
      std::vector<std::uint8_t> mutated = input;
      mutated.resize(std::max(kLongest, input.size()));
      mutated.resize(LLVMFuzzerCustomMutator(mutated.data(), input.size(), mutated.size(), i));
      mutated.shrink_to_fit();  // lets sanitizers detect reads past the end of the mutated input
      LLVMFuzzerTestOneInput(mutated.data(), mutated.size());
    }
    inputs += 1 + mutations;
  }
  std::cout << files.size() << " files, " << inputs << " inputs\n";
  return files.empty() ? 1 : 0;
}
