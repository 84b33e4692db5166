// Mutations that know the form of an input, so that what lies behind a checksum or a parser is reached.
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

// An input of several byte strings: each with its length before it, two bytes, little-endian. Any bytes are such an
// input: a length that goes too far is cut.
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
  std::uint64_t number();  // at an edge, small, or any
  double real();           // at an edge of what a double or the physics takes

 private:
  std::mt19937 engine_;
};

void mutate_bytes(std::string& bytes, std::size_t longest);          // by the driver
void mutate_reals(std::string& payload, Random& random);             // one of the 8-byte numbers
void mutate(google::protobuf::Message& message, Random& random);     // one field, somewhere in it
void mutate_header(std::string& frame, bool reply, Random& random);  // as a message, where it is one

// Makes size and sum in the header those of the payload, where the header parses.
void mend_payload(std::string& header, const std::string& payload, bool reply);

// Writes an input back for the driver; `before` stays where the new one is too long.
std::size_t give(const std::string& input, std::uint8_t* data, std::size_t before, std::size_t max_size);

}  // namespace shearbus::fuzz
