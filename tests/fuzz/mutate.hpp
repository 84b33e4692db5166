// Mutations that keep the format of an input, so that the input passes checksums and parsers and reaches the code
// behind them.
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

// Unpacks an input that consists of several byte strings, each after its length in two little-endian bytes. Any bytes
// are a valid input: a string that would go beyond the end is cut at the end.
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
  std::uint64_t number();  // an integer at an edge of its range, a small integer, or any integer
  double real();           // a real at an edge of the range that a double or the physics accepts

 private:
  std::mt19937 engine_;
};

void mutate_bytes(std::string& bytes, std::size_t longest);       // changes bytes by the mutator of the fuzzer
void mutate_reals(std::string& payload, Random& random);          // changes one of the 8-byte numbers of a payload
void mutate_places(std::string& payload, Random& random);         // makes one of these numbers a small integer
void mutate(google::protobuf::Message& message, Random& random);  // changes one field of a message, at any depth
// Changes one field of a header: of a reply's header if `reply` is true, otherwise of a request's header. If the frame
// cannot be parsed as a header, changes its bytes.
void mutate_header(std::string& frame, bool reply, Random& random);

// Sets the payload size and checksum of a header to those of `payload`. A header that cannot be parsed stays as it is.
void mend_payload(std::string& header, const std::string& payload, bool reply);

// Copies the new input to `data`, the fuzzer's buffer, and returns its size. If the new input is empty or longer than
// `max_size`, the old input stays, and its size `before` is returned.
std::size_t give(const std::string& input, std::uint8_t* data, std::size_t before, std::size_t max_size);

}  // namespace shearbus::fuzz
