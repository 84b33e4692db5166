// Fuzzes the decoding of frames from a socket, both as a request and as a reply. A decoded message encodes to bytes that
// decode to the same message.
#include <optional>

#include "proto/wire/codec.hpp"
#include "proto/wire/envelope_scan.hpp"
#include "proto/wire/status.hpp"
#include "tests/fuzz/mutate.hpp"
#include "tests/fuzz/target.hpp"

namespace shearbus::fuzz {
namespace {

constexpr std::size_t kMostFrames = 4;

template <typename Message>
std::optional<std::string> again(const Message& message) {
  try {
    return wire::encode_header(message);
  } catch (const wire::Error&) {
    return std::nullopt;  // a message that was decoded may exceed the size limit when it is encoded again
  }
}

template <typename Message>
void decode_both_ways(const Parts& parts) {
  const auto views = views_of(parts);
  Message message;
  try {
    wire::decode(views, message);
  } catch (const wire::Error& fault) {
    require(!fault.status().ok() && !fault.status().text.empty(), "a refusal says why");
    return;
  }
  for (const wire::Column& column : message.batch.columns())
    require(column.offset_bytes + column.count * wire::size_of(column.element) <= message.batch.bytes().size(),
            "a column lies within its frame");
  const auto first = again(message);
  if (!first) return;
  const std::vector<std::span<const std::byte>> frames = {std::as_bytes(std::span(*first)), message.batch.bytes()};
  Message back;
  wire::decode(std::span(frames).first(message.batch.columns().empty() ? 1 : 2), back);
  require(again(back) == first, "what was decoded encodes to what decodes to the same");
}

}  // namespace
}  // namespace shearbus::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace shearbus;
  fuzz::Parts parts = fuzz::unpack(data, size);
  if (parts.size() > fuzz::kMostFrames) parts.resize(fuzz::kMostFrames);
  if (!parts.empty()) {
    const wire::EnvelopeScan scan = wire::scan_envelope(std::as_bytes(std::span(parts[0])));
    fuzz::require(scan.session_id.size() <= parts[0].size(), "what is scanned lies within the frame");
  }
  fuzz::decode_both_ways<wire::Request>(parts);
  fuzz::decode_both_ways<wire::Reply>(parts);
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned int seed) {
  using namespace shearbus::fuzz;
  Random random(seed);
  Parts parts = unpack(data, size);
  if (parts.empty() || random.one_in(8)) return LLVMFuzzerMutate(data, size, max_size);
  const bool reply = random.one_in(2);
  if (parts.size() > 1 && random.one_in(3))
    mutate_bytes(parts[1], parts[1].size() + 32);
  else if (random.one_in(3))
    mutate_bytes(parts[0], parts[0].size() + 32);
  else
    mutate_header(parts[0], reply, random);
  if (parts.size() > 1 && !random.one_in(8)) mend_payload(parts[0], parts[1], reply);
  return give(pack(parts), data, size, max_size);
}
