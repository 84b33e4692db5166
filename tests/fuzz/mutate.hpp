// Mutations that keep the format of an input, so that it passes checksums and parsers and reaches the code after them.
#pragma once

#include <google/protobuf/message.h>

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <string>
#include <vector>

namespace shearbus::fuzz {

using Parts = std::vector<std::string>;

// Unpacks an input that consists of several byte strings, each preceded by its length in two little-endian bytes. Any
// bytes are a valid input: a string whose length goes beyond the end is cut there.
Parts unpack(const std::uint8_t* data, std::size_t size);
std::string pack(const Parts& parts);

std::vector<std::span<const std::byte>> views_of(const Parts& parts);

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  std::size_t below(std::size_t n) {
    return n == 0 ? 0 : std::uniform_int_distribution<std::size_t>(0, n - 1)(engine_);
  }
  bool one_in(std::size_t n) { return below(n) == 0; }
  std::uint64_t number();  // a number at an edge of its range, a small number, or any number
  double real();           // a real at an edge of the range that a double or the physics accepts

 private:
  std::mt19937 engine_;
};

void mutate_bytes(std::string& bytes, std::size_t longest);       // uses the mutator of the driver
void mutate_reals(std::string& payload, Random& random);          // changes one of the 8-byte numbers
void mutate(google::protobuf::Message& message, Random& random);  // changes one field at any depth
// Changes the frame as a message, if it parses as one.
void mutate_header(std::string& frame, bool reply, Random& random);

// If the header can be parsed, sets its payload size and checksum to those of `payload`.
void mend_payload(std::string& header, const std::string& payload, bool reply);

// Copies the new input to `data`, the buffer of the driver, and returns its size. If the new input is empty or too
// long, the old one stays, and its size `before` is returned.
std::size_t give(const std::string& input, std::uint8_t* data, std::size_t before, std::size_t max_size);

}  // namespace shearbus::fuzz
